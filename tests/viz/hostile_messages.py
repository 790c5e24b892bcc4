"""Messages that a hostile page could send, made from viser's own types and from those of the drive socket.

Seeded, endless, and without an end of their own: who uses them says how many. Well-formed ones have fields of the types
that the protocol declares and are about things that are there; hostile ones break that in one or more ways.
"""

import json
import random
import typing
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
import viser
from viser import _messages
from viser.infra import _messages as infra_messages

from ltvn_viz.server.drive_messages import MessageError
from ltvn_viz.server.guarded_server import GuardedServer
from ltvn_viz.server.keymap import Direction
from ltvn_viz.server.page_messages import read_viser_message
from ltvn_viz.wishes.commands import Action
from ltvn_viz.wishes.wish import fits

WATCHERS_OWN = frozenset({Action.STOP, Action.TAKE_OVER, Action.RELEASE})
"""A watcher may do this, and it is meant to change something for all."""

NASTY_NUMBERS = (1e300, -1e300, float("nan"), float("inf"), -float("inf"), -1, 0, 2**31, 2**53, 2**63, -(2**63), 1e-320)
NASTY_TEXTS = (
    "",
    "removed",
    "../../etc/passwd",
    "\x00",
    "x" * 100_000,
    "<img src=x onerror=alert(1)>",
    "\ud7ff\u202e",
    "root",
    "value",
    "__class__",
)


@dataclass(frozen=True)
class Targets:
    """What there is to aim at."""

    elements: Sequence[tuple[str, Any]]
    """Each element's name and its present value."""
    nodes: Sequence[str]
    """Names in the scene."""
    graph_nodes: Sequence[int] = ()
    recordings: Sequence[str] = ()


def targets_of(
    server: GuardedServer,
    graph_nodes: Sequence[int] = (),
    recordings: Sequence[str] = (),
    clients: Sequence[viser.ClientHandle] = (),
) -> Targets:
    """Return all that the pages of a server share, and what some pages have for themselves."""
    scene = server.viser.scene
    guis = [server.viser.gui, *(client.gui for client in clients)]
    elements = [pair for gui in guis for pair in list(gui._gui_input_handle_from_uuid.items())]
    return Targets(elements, list(scene._handle_from_node_name), graph_nodes, recordings)


def is_readable(message: bytes) -> bool:
    """Tell whether bytes are a message to viser at all; others close the socket of the page that sent them."""
    try:
        read_viser_message(message)
    except MessageError:
        return False
    return True


class HostileMessages:
    """Draws messages with a seed."""

    def __init__(self, seed: int, targets: Targets) -> None:
        """Aim at `targets`."""
        self._random = random.Random(seed)
        self._targets = targets
        kinds = _messages.Message.get_subclasses()
        self._kinds = sorted(kinds, key=lambda kind: kind.__name__)

    def well_formed(self) -> Iterator[bytes]:
        """Yield messages to viser that its own page could have sent."""
        makers: Sequence[Callable[[], dict[str, Any]]] = (self._update, self._update, self._typed)
        while True:
            yield msgspec.msgpack.encode(self._random.choice(makers)())

    def hostile(self) -> Iterator[bytes]:
        """Yield messages to viser that break its rules."""
        makers: Sequence[Callable[[], bytes]] = (
            self._nasty_update,
            self._wrong_fields,
            self._wrong_kind,
            self._noise,
            self._nested,
        )
        while True:
            yield self._random.choice(makers)()

    def drive_well_formed(self) -> Iterator[str]:
        """Yield messages of the drive socket, but for what every page may do to all."""
        actions = sorted(set(Action) - WATCHERS_OWN)
        while True:
            yield json.dumps(
                self._random.choice(
                    (
                        {"type": "action", **self._wish(actions)},
                        {
                            "type": "drive",
                            "held": self._random.sample(list(Direction), self._random.randrange(5)),
                            "stick": [self._random.uniform(-1, 1), self._random.uniform(-1, 1)],
                            "slow": self._random.random() < 0.5,
                            "epoch": self._random.randrange(50),
                            "age": self._random.randrange(2000),
                        },
                        {"type": "link", "query": self._link()},
                        {"type": "view", "scene": self._random.random() < 0.5, "camera": True},
                        {"type": "here"},
                    )
                )
            )

    def drive_hostile(self) -> Iterator[str | bytes]:
        """Yield what the drive socket must refuse."""
        for text in self.drive_well_formed():
            fields = json.loads(text)
            name = self._random.choice(sorted(fields))
            fields[name] = self._random.choice([*NASTY_NUMBERS, *NASTY_TEXTS[:4], None, [], {}, True])
            yield self._random.choice((json.dumps(fields), text[: self._random.randrange(len(text))], self._noise()))

    def _update(self) -> dict[str, Any]:
        uuid, element = self._random.choice(self._targets.elements)
        return {"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": self._value_for(element)}}

    def _click(self) -> dict[str, Any]:
        return {
            "type": "SceneNodeClickMessage",
            "name": self._random.choice(["/graph/nodes", "/graph/nodes", *self._targets.nodes]),
            "instance_index": self._random.choice((None, self._random.randrange(60))),
            "ray_origin": self._numbers(3),
            "ray_direction": self._numbers(3),
            "screen_pos": self._numbers(2),
            "modifier": self._random.choice((None, "shift", "cmd/ctrl+alt")),
            "owner": "",
        }

    def _typed(self) -> dict[str, Any]:
        """A message of any kind that viser knows, with fields of the declared types."""
        kind = self._random.choice(self._kinds)
        hints = infra_messages.get_type_hints_cached(kind)
        fields = {name: self._of_type(hints[name]) for name in infra_messages.wire_field_names(kind)}
        return {"type": kind.__name__, **fields}

    def _nasty_update(self) -> bytes:
        uuid, element = self._random.choice(self._targets.elements)
        name = self._random.choice(
            ("value", "value", "removed", "disabled", "visible", "uuid", "props", "update_cb", "is_button")
        )
        value = self._random.choice(
            (*NASTY_NUMBERS, *NASTY_TEXTS, None, [], {}, True, [1e300, 1e300], self._value_for(element))
        )
        return _encoded({"type": "GuiUpdateMessage", "uuid": uuid, "updates": {name: value}})

    def _wrong_fields(self) -> bytes:
        message = self._random.choice((self._update, self._click, self._typed))()
        name = self._random.choice(sorted(message))
        match self._random.randrange(3):
            case 0:
                del message[name]
            case 1:
                message[name] = self._random.choice((*NASTY_NUMBERS, *NASTY_TEXTS, None, [], {}))
            case _:
                message["excluded_self_client"] = self._random.choice(NASTY_NUMBERS)
        return _encoded(message)

    def _wrong_kind(self) -> bytes:
        kind = self._random.choice(("Message", "_CreateSceneNodeMessage", "object", "", 3, None, ["GuiUpdateMessage"]))
        return _encoded({"type": kind, "uuid": "x"})

    def _noise(self) -> bytes:
        return self._random.randbytes(self._random.randrange(1, 400))

    def _nested(self) -> bytes:
        depth = self._random.randrange(10, 5000)
        return self._random.choice((b"\x91", b"\x81\xa1a")) * depth + b"\xc0"

    def _value_for(self, element: Any) -> Any:
        options = getattr(element, "options", None)
        if options:
            return self._random.choice(list(options))
        value = getattr(element, "value", True)
        least, most = getattr(element, "min", None), getattr(element, "max", None)
        if isinstance(value, int | float) and not isinstance(value, bool) and least is not None and most is not None:
            return self._random.uniform(least, most)
        return self._of_type(type(value))

    def _of_type(self, hint: Any) -> Any:
        origin, arguments = typing.get_origin(hint), typing.get_args(hint)
        if origin is typing.Literal:
            return self._random.choice(arguments)
        if origin is typing.Union or str(origin) == "<class 'types.UnionType'>":
            return self._of_type(self._random.choice(arguments))
        if origin is tuple:
            count = len(arguments) if ... not in arguments else self._random.randrange(4)
            return [self._of_type(arguments[0 if ... in arguments else each]) for each in range(count)]
        plain: dict[Any, Callable[[], Any]] = {
            bool: lambda: self._random.random() < 0.5,
            int: lambda: self._random.randrange(200),
            float: lambda: self._random.uniform(-100, 100),
            bytes: lambda: self._random.randbytes(20),
            type(None): lambda: None,
            dict: lambda: {"value": 1},
        }
        return plain.get(origin or hint, self._text)()

    def _text(self) -> str:
        uuids = [uuid for uuid, _ in self._targets.elements]
        return self._random.choice(
            [*uuids, *self._targets.nodes, *self._targets.recordings, "Take the lift", "12 40", "all"]
        )

    def _numbers(self, count: int) -> list[float]:
        return [self._random.uniform(-10, 10) for _ in range(count)]

    def _wish(self, actions: Sequence[Action]) -> dict[str, Any]:
        action = self._random.choice(actions)
        number = self._random.choice((self._random.randrange(2000), *self._targets.graph_nodes[:20]))
        values = (
            None,
            number,
            self._random.randrange(2),
            self._text(),
            (self._random.uniform(-9, 9), 1.0),
            (number, 7),
        )
        fitting = [value for value in values if fits(value, action.wish.takes)]
        return {"action": action, "value": self._random.choice(fitting)}

    def _link(self) -> str:
        name = self._random.choice([*self._targets.recordings, "none.rrd"])
        return self._random.choice((f"replay={name}&at=1", "tool=hand&node=3", "tool=edge&edge=1-2", "at=3"))


def _encoded(message: dict[str, Any]) -> bytes:
    return msgspec.msgpack.encode(message)
