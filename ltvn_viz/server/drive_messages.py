"""The messages between page and server on the `/drive` socket, and their strict parser.

Owns the JSON format. A message of a page is valid only if all its fields are known, present and in range; the sender of
an invalid message loses its socket, and with it the seat.
"""

import json
from dataclasses import dataclass
from typing import Any, TypeAlias

from ltvn_core.structured_text import parse_json
from ltvn_viz.server.driver_seat import ClientId, HeldInput, SeatState
from ltvn_viz.server.keymap import Direction
from ltvn_viz.wishes.commands import Action, Ask, Value
from ltvn_viz.wishes.wish_table import MAX_WHOLE, WISHES

MAX_MESSAGE_BYTES = 4096
_HERE_TEXT = '{"type":"here"}'


class MessageError(ValueError):
    """A page sent a message that is not part of the protocol."""

    told = "invalid message"
    """Text for the page when its socket is closed."""


@dataclass(frozen=True, slots=True)
class DriveMessage:
    """The inputs held on a page, and the epoch that the page knows."""

    held: HeldInput
    epoch: int
    age_s: float
    """Age of the input in seconds when the message was sent; a page that is busy drawing sends late."""


@dataclass(frozen=True, slots=True)
class HereMessage:
    """A sign of life, which each page sends regularly."""


@dataclass(frozen=True, slots=True)
class LinkMessage:
    """The page was opened by a link to a certain view."""

    query: str
    """Query of the page's address, not parsed yet."""


@dataclass(frozen=True, slots=True)
class ViewMessage:
    """What the page shows of the map."""

    shows_scene: bool
    """Whether it shows the 3D scene, and not the plan view."""
    shows_camera: bool
    """Whether it shows what the robot sees."""


PageMessage: TypeAlias = DriveMessage | Ask | LinkMessage | ViewMessage | HereMessage

HERE = HereMessage()


def parse_message(text: str | bytes) -> PageMessage:
    """Parse one message of a page; raises MessageError."""
    if text == _HERE_TEXT:
        return HERE  # The fast path: every page sends this 20 times a second.
    try:
        fields = parse_json(text, _refuse_constant)
    except ValueError as error:
        raise MessageError(f"not JSON: {error}") from error
    if not isinstance(fields, dict):
        raise MessageError("not an object")
    match fields:
        case {"type": "drive", "held": held, "stick": stick, "slow": bool(slow), "epoch": epoch, "age": age} if (
            len(fields) == 6
        ):
            return DriveMessage(HeldInput(_directions(held), _stick(stick), slow), _whole(epoch), _whole(age) / 1000)
        case {"type": "action", "action": str(name), "value": value} if len(fields) == 3:
            action = _action(name)
            return Ask(action, _carried(action, value))
        case {"type": "link", "query": str(query)} if len(fields) == 2:
            return LinkMessage(query)
        case {"type": "view", "scene": bool(shows_scene), "camera": bool(shows_camera)} if len(fields) == 3:
            return ViewMessage(shows_scene, shows_camera)
        case {"type": "here"} if len(fields) == 1:
            return HERE
        case _:
            valid = "a drive, an action, a link, a view or a heartbeat would be valid"
            raise MessageError(f"unknown message with the fields {sorted(fields)}; {valid}")


BEAT_MESSAGE = '{"type": "beat"}'
"""Sign of life of the server; `socket_worker.js` compares it literally."""


def state_message(client: ClientId, seat: SeatState) -> str:
    """Return a message with the state of the seat for one page."""
    state = {
        "type": "state",
        "you": client,
        "driver": seat.driver,
        "epoch": seat.epoch,
        "armed": seat.is_armed,
        "reason": seat.reason,
        "stoppedBy": seat.stopped_by,
    }
    return json.dumps(state)


def refusal_message(driver: ClientId) -> str:
    """Return a message that an action was refused, because another page drives."""
    return json.dumps({"type": "refused", "driver": driver})


def _directions(value: Any) -> frozenset[Direction]:
    if not isinstance(value, list) or len(value) > len(Direction):
        raise MessageError("held must be a list of directions")
    try:
        return frozenset(Direction(name) for name in value)
    except (ValueError, TypeError) as error:
        raise MessageError(f"held: {error}; valid are {', '.join(Direction)}") from error


def _stick(value: Any) -> tuple[float, float]:
    match value:
        case [int() | float() as forward, int() | float() as left]:
            if not any(isinstance(part, bool) for part in value) and max(abs(forward), abs(left)) <= 1:
                return float(forward), float(left)
        case _:
            pass
    raise MessageError("stick must be two numbers in [-1, 1]")


def _whole(value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= MAX_WHOLE:
        raise MessageError("epoch and age (ms) must be whole numbers from 0")
    return value


def _carried(action: Action, value: Any) -> Value:
    match value:
        case [int() | float() as x, int() | float() as y] if not isinstance(x, bool) and not isinstance(y, bool):
            carried: Value = (x, y)
        case None | int() | str():
            carried = value
        case _:
            raise MessageError("value must be null, a whole number, a text or a place")
    if not WISHES[action].carries.fits(carried):
        raise MessageError(f"{action} carries {WISHES[action].carries.name.lower()}, within limits")
    return carried


def _action(name: str) -> Action:
    try:
        return Action(name)
    except ValueError as error:
        raise MessageError(f"{error}; valid are {', '.join(Action)}") from error


def _refuse_constant(name: str) -> float:
    raise MessageError(f"{name} is not a number")
