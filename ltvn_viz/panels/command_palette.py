"""The command palette (Ctrl K): a searchable list of all actions, questions, recordings and changes of the world.

Owns the entries, and the reason why one is not possible now. viser draws the palette and searches in it; the typed
number of “Go to node …” is read by the page's script (`static/palette.js`).
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass

import viser

from ltvn_viz.panels.world_panel import LIGHTS
from ltvn_viz.server.keymap import key_label
from ltvn_viz.session.snapshot import Snapshot, WorldView
from ltvn_viz.wishes.commands import Ask
from ltvn_viz.wishes.modes import reason_against as reason_in_mode
from ltvn_viz.wishes.wish import Need
from ltvn_viz.wishes.wish_table import Action

GO_TO_NODE = "Go to node …"
"""Label of the one entry for all nodes; `static/palette.js` knows it."""
_TYPE_A_NUMBER = "Type its number, as in: node 30"
_LACKS: Mapping[Need, Callable[[Snapshot], bool]] = {
    Need.NO_RECORDING: lambda now: now.recording.name is not None,
    Need.RECORDING: lambda now: now.recording.name is None,
    Need.REBUILD: lambda now: not now.can_undo_build,
    Need.FREE_MAKER: lambda now: now.is_making,
    Need.PLAYED_DRIVE: lambda now: now.drive_is_over is None,
    Need.OBEDIENT_ROBOT: lambda now: now.is_open_loop,
    Need.WORLD: lambda now: now.world is None,
    Need.CHANGE: lambda now: now.world is not None and not now.world.undo,
    Need.NO_STORY: lambda now: now.story_goes_on,
    Need.STORY: lambda now: bool(now.no_story),
    Need.FLOOR_PLAN: lambda now: now.floor_plan is None,
}
"""Tells of each need whether a wish lacks it now."""


@dataclass(slots=True)
class _Shown:
    handle: viser.CommandHandle
    why_not: str


class CommandPalette:
    """The entries of the palette; shared by all pages, used by the one that drives."""

    def __init__(self, gui: viser.GuiApi, send: Callable[[Ask], None]) -> None:
        """Start with an empty list; `send` takes wishes and returns at once."""
        self._gui = gui
        self._send = send
        self._shown: dict[str, _Shown] = {}
        self._entries: Mapping[str, Ask] = {}
        self._listed: object = None

    def show(self, snapshot: Snapshot) -> None:
        """Update the entries, and grey those that are not possible now, with the reason."""
        listed = snapshot.inspection.offered, tuple(snapshot.recordings), snapshot.sources, _changeable(snapshot.world)
        if listed != self._listed:
            self._listed = listed
            self._list(dict(_entries(snapshot)), snapshot)
        for label, shown in self._shown.items():
            if (why_not := reason_against(self._entries[label].action, snapshot)) != shown.why_not:
                shown.why_not = why_not
                shown.handle.disabled = bool(why_not)
                shown.handle.description = _description(self._entries[label], why_not)

    def _list(self, entries: Mapping[str, Ask], snapshot: Snapshot) -> None:
        """List the entries in their order: viser shows the first of two that match equally well first."""
        fresh = list(entries)
        same = 0
        for before, now in zip(self._shown, fresh, strict=False):
            if before != now or self._entries[before] != entries[now]:
                break
            same += 1
        for label in list(self._shown)[same:]:
            self._shown.pop(label).handle.remove()
        for label in fresh[same:]:
            self._shown[label] = self._added(label, entries[label], reason_against(entries[label].action, snapshot))
        self._entries = entries

    def _added(self, label: str, entry: Ask, why_not: str) -> _Shown:
        description = _description(entry, why_not)
        handle = self._gui.add_command(label, description=description, disabled=bool(why_not))

        @handle.on_trigger
        async def _(_: viser.CommandEvent) -> None:
            if label != GO_TO_NODE:  # The page asks with the number; without one the robot stays.
                self._send(entry)

        return _Shown(handle, why_not)


def list_stop(gui: viser.GuiApi, stop: Callable[[], None]) -> None:
    """List the stop on one page; every page has it, with the driver's seat or without."""
    handle = gui.add_command(f"Stop: {Action.STOP.wish.help}", description=f"Key: {key_label(Action.STOP)}")

    @handle.on_trigger
    async def _(_: viser.CommandEvent) -> None:
        stop()


def reason_against(action: Action, snapshot: Snapshot) -> str:
    """Return why an action is not possible now; empty if it is."""
    if in_this_mode := reason_in_mode(action.wish.modes, snapshot.mode):
        return in_this_mode
    lacking = next((need for need in action.wish.needs if _LACKS[need](snapshot)), None)
    if lacking is None:
        return ""
    return snapshot.no_story if lacking is Need.STORY else lacking.value


def _description(entry: Ask, why_not: str) -> str | None:
    if why_not:
        return f"Not possible now: {why_not}"
    if entry.action is Action.GOAL and entry.value is not None:
        return _TYPE_A_NUMBER
    keys = key_label(entry.action) if entry.value is None else ""
    return f"Key: {keys}" if keys else None


def _changeable(world: WorldView | None) -> object:
    """Return what the entries about the world depend on."""
    return None if world is None else (world.doors, tuple(box.number for box in world.boxes))


def _entries(snapshot: Snapshot) -> Iterator[tuple[str, Ask]]:
    """Yield all labels with their entries, in the order of the list."""
    yield GO_TO_NODE, Ask(Action.GOAL, 0)
    for action in Action:
        if action.wish.is_listed:
            yield action.wish.help[0].upper() + action.wish.help[1:], Ask(action)
    if snapshot.world is not None:
        yield from _changes(snapshot.world)
    for question in snapshot.inspection.offered:
        yield f"Ask: {question}", Ask(Action.QUESTION, str(question))
    for name in _shortest_first(snapshot.recordings):
        yield f"Open recording {name}", Ask(Action.OPEN, name)
    for name in _shortest_first(snapshot.sources):
        yield f"Import {name}", Ask(Action.IMPORT, name)


def _shortest_first(names: Iterable[str]) -> list[str]:
    """Return names so that one that is typed in full comes before those that only begin with it."""
    return sorted(names, key=lambda name: (len(name), name))


def _changes(world: WorldView) -> Iterator[tuple[str, Ask]]:
    for door in world.doors:
        yield f"{'Close' if door.is_open else 'Open'} the door {door.label}", Ask(Action.DOOR, door.door)
    yield Action.AIM_BOX.wish.label, Ask(Action.AIM_BOX, 0)
    for box in world.boxes:
        yield f"Move box {box.number}", Ask(Action.AIM_BOX, box.number)
        yield f"Take away box {box.number}", Ask(Action.TAKE_BOX, box.number)
    for name, percent in LIGHTS:
        yield f"Light: {name.lower()} ({percent} %)", Ask(Action.LIGHT, percent)
