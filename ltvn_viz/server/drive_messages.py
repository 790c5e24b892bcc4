"""The messages between page and server on the `/drive` socket, and their strict parser.

Owns the JSON format. A message of a page is valid only if all its fields are known, present and in range; the sender of
an invalid message loses its socket, and with it the seat.
"""

import json
from typing import Annotated, TypeAlias

import msgspec
from msgspec import Meta

from ltvn_core.structured_text import parse_json
from ltvn_viz.server.driver_seat import ClientId, SeatState
from ltvn_viz.server.keymap import Direction
from ltvn_viz.wishes.commands import Ask
from ltvn_viz.wishes.wish import Whole
from ltvn_viz.wishes.wish_table import Action

MAX_MESSAGE_BYTES = 4096
_HERE_TEXT = '{"type":"here"}'


class MessageError(ValueError):
    """A page sent a message that is not part of the protocol."""

    told = "invalid message"
    """Text for the page when its socket is closed."""


_Share: TypeAlias = Annotated[float, Meta(ge=-1, le=1)]


class DriveMessage(msgspec.Struct, frozen=True, tag="drive", tag_field="type", forbid_unknown_fields=True):
    """The inputs held on a page, and the epoch that the page knows."""

    held: Annotated[frozenset[Direction], Meta(max_length=len(Direction))]
    stick: tuple[_Share, _Share]
    slow: bool
    epoch: Whole
    age: Whole
    """Age of the input in milliseconds when the message was sent; a page that is busy drawing sends late."""


class HereMessage(msgspec.Struct, frozen=True, tag="here", tag_field="type", forbid_unknown_fields=True):
    """A sign of life, which each page sends regularly."""


class LinkMessage(msgspec.Struct, frozen=True, tag="link", tag_field="type", forbid_unknown_fields=True):
    """The page was opened by a link to a certain view."""

    query: str
    """Query of the page's address, not parsed yet."""


class ViewMessage(msgspec.Struct, frozen=True, tag="view", tag_field="type", forbid_unknown_fields=True):
    """What the page shows of the map."""

    scene: bool
    """Whether it shows the 3D scene, and not the plan view."""
    camera: bool
    """Whether it shows what the robot sees."""


class _ActionMessage(msgspec.Struct, frozen=True, tag="action", tag_field="type", forbid_unknown_fields=True):
    """A press or a click, with its value."""

    action: Action
    value: object
    """Checked by the row of the action."""


PageMessage: TypeAlias = DriveMessage | Ask | LinkMessage | ViewMessage | HereMessage

HERE = HereMessage()


def parse_message(text: str | bytes) -> PageMessage:
    """Parse one message of a page; raises MessageError."""
    if text == _HERE_TEXT:
        return HERE  # The fast path: every page sends this 20 times a second.
    try:
        fields = parse_json(text, _refuse_constant)
        message = msgspec.convert(fields, DriveMessage | LinkMessage | ViewMessage | HereMessage | _ActionMessage)
        if not isinstance(message, _ActionMessage):
            return message
        return Ask(message.action, message.action.wish.value_of(message.value))
    except (ValueError, OverflowError) as error:
        raise MessageError(f"not a message of a page: {str(error)!r:.200}") from error


def _refuse_constant(name: str) -> float:
    raise MessageError(f"{name} is not a number")


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
