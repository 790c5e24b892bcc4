"""The command palette (Ctrl K): a searchable list of all actions, questions, recordings and changes of the world.

Owns the entries, and the reason why one is not possible now. viser draws the palette and searches in it; the typed
number of “Go to node …” is read by the page's script (`static/palette.js`).
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import viser

from ltvn_viz.panels.world_panel import LIGHTS
from ltvn_viz.server.keymap import key_label
from ltvn_viz.session.snapshot import Snapshot, WorldView
from ltvn_viz.wishes.commands import UNDER_WAY, Action, Mode, Value
from ltvn_viz.wishes.wish_table import WISHES

GO_TO_NODE = "Go to node …"
"""Label of the one entry for all nodes; `static/palette.js` knows it."""
_TYPE_A_NUMBER = "Type its number, as in: node 30"
_NOT_NOW: Mapping[Mode, str] = {
    Mode.BUILDING: "while the map is being built",
    Mode.NAVIGATING: "while the robot drives to a goal",
    Mode.PAUSED: "while a query is paused",
    Mode.REPLAY: "while a recording is open",
}


class Entry(NamedTuple):
    """The action that an entry of the palette requests, with its value."""

    action: Action
    value: Value = None


@dataclass(slots=True)
class _Shown:
    handle: viser.CommandHandle
    why_not: str


class CommandPalette:
    """The entries of the palette; shared by all pages, used by the one that drives."""

    def __init__(self, gui: viser.GuiApi, ask: Callable[[Action, Value], None]) -> None:
        """Start with an empty list; `ask` takes actions and returns at once."""
        self._gui = gui
        self._ask = ask
        self._shown: dict[str, _Shown] = {}
        self._entries: Mapping[str, Entry] = {}
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

    def _list(self, entries: Mapping[str, Entry], snapshot: Snapshot) -> None:
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

    def _added(self, label: str, entry: Entry, why_not: str) -> _Shown:
        description = _description(entry, why_not)
        handle = self._gui.add_command(label, description=description, disabled=bool(why_not))

        @handle.on_trigger
        async def _(_: viser.CommandEvent) -> None:
            if label != GO_TO_NODE:  # The page asks with the number; without one the robot stays.
                self._ask(entry.action, entry.value)

        return _Shown(handle, why_not)


def list_stop(gui: viser.GuiApi, stop: Callable[[], None]) -> None:
    """List the stop on one page; every page has it, with the driver's seat or without."""
    wish = WISHES[Action.STOP]
    handle = gui.add_command(f"Stop: {wish.help}", description=f"Key: {key_label(Action.STOP)}")

    @handle.on_trigger
    async def _(_: viser.CommandEvent) -> None:
        stop()


def reason_against(action: Action, snapshot: Snapshot) -> str:
    """Return why an action is not possible now; empty if it is."""
    modes = WISHES[action].modes
    if snapshot.mode not in modes:
        if (now := _NOT_NOW.get(snapshot.mode)) is not None:
            return f"not {now}"
        return "only while the robot drives to a goal" if modes & UNDER_WAY else "only while a recording is open"
    return _missing(action, snapshot)


def _missing(action: Action, snapshot: Snapshot) -> str:
    """Return what an action lacks, though the app is in the right mode for it."""
    is_recording = snapshot.recording.name is not None
    match action:
        case Action.RECORD if is_recording:
            return "a recording is under way"
        case Action.KEEP | Action.DISCARD if not is_recording:
            return "no recording is under way"
        case Action.UNDO_BUILD if not snapshot.can_undo_build:
            return "the map was not rebuilt"
        case Action.BUILD if snapshot.is_making:
            return "another recording is being made"
        case Action.PLAY_DRIVE if snapshot.drive_is_over is None:
            return "the robot is no recorded drive"
        case Action.GOAL if snapshot.is_open_loop:
            return "a recorded drive obeys no command"
        case Action.PUT_BOX | Action.UNDO_CHANGE | Action.WATCH_IT_LEARN if snapshot.world is None:
            return "only a simulated world can be changed"
        case Action.UNDO_CHANGE if snapshot.world is not None and not snapshot.world.undo:
            return "nothing was changed by hand"
        case Action.WATCH_IT_LEARN if snapshot.story_goes_on:
            return "the story is under way"
        case Action.WATCH_IT_LEARN:
            return snapshot.no_story
        case Action.ALIGN_PLAN | Action.UNDO_PLAN_CLICK | Action.USE_ALIGNMENT if snapshot.floor_plan is None:
            return "there is no floor plan"
        case _:
            return ""


def _description(entry: Entry, why_not: str) -> str | None:
    if why_not:
        return f"Not possible now: {why_not}"
    if entry.action is Action.GOAL and entry.value is not None:
        return _TYPE_A_NUMBER
    keys = key_label(entry.action) if entry.value is None else ""
    return f"Key: {keys}" if keys else None


def _changeable(world: WorldView | None) -> object:
    """Return what the entries about the world depend on."""
    return None if world is None else (world.doors, tuple(box.number for box in world.boxes))


def _entries(snapshot: Snapshot) -> Iterator[tuple[str, Entry]]:
    """Yield all labels with their entries, in the order of the list."""
    yield GO_TO_NODE, Entry(Action.GOAL, 0)
    for action, wish in WISHES.items():
        if wish.is_listed:
            yield wish.help[0].upper() + wish.help[1:], Entry(action)
    if snapshot.world is not None:
        yield from _changes(snapshot.world)
    for question in snapshot.inspection.offered:
        yield f"Ask: {question}", Entry(Action.QUESTION, str(question))
    for name in _shortest_first(snapshot.recordings):
        yield f"Open recording {name}", Entry(Action.OPEN, name)
    for name in _shortest_first(snapshot.sources):
        yield f"Import {name}", Entry(Action.IMPORT, name)


def _shortest_first(names: Iterable[str]) -> list[str]:
    """Return names so that one that is typed in full comes before those that only begin with it."""
    return sorted(names, key=lambda name: (len(name), name))


def _changes(world: WorldView) -> Iterator[tuple[str, Entry]]:
    for door in world.doors:
        yield f"{'Close' if door.is_open else 'Open'} the door {door.label}", Entry(Action.DOOR, door.door)
    yield WISHES[Action.AIM_BOX].label, Entry(Action.AIM_BOX, 0)
    for box in world.boxes:
        yield f"Move box {box.number}", Entry(Action.AIM_BOX, box.number)
        yield f"Take away box {box.number}", Entry(Action.TAKE_BOX, box.number)
    for name, percent in LIGHTS:
        yield f"Light: {name.lower()} ({percent} %)", Entry(Action.LIGHT, percent)
