"""The command palette (Ctrl K): a searchable list of all actions, questions, recordings and places of the map.

Owns the entries and when each is enabled. viser draws the palette and searches in it.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

import viser

from ltvn_core.analysis.map_history import GraphArrays
from ltvn_core.types import NodeId
from ltvn_viz.server.keymap import key_label
from ltvn_viz.session.inspection import QuestionName
from ltvn_viz.session.snapshot import Snapshot
from ltvn_viz.wishes.commands import Mode
from ltvn_viz.wishes.wish_table import WISHES, Action, Value

MOST_NODES = 500
"""Largest number of nodes that are all listed; in a larger map only the nodes of the gallery are."""


class Entry(NamedTuple):
    """The action that an entry of the palette requests, with its value."""

    action: Action
    value: Value = None


class _Shown(NamedTuple):
    handle: viser.CommandHandle
    modes: frozenset[Mode]


class CommandPalette:
    """The entries of the palette; shared by all pages, used by the one that drives."""

    def __init__(self, gui: viser.GuiApi, ask: Callable[[Action, Value], None]) -> None:
        """Start with an empty list; `ask` takes actions and returns at once."""
        self._gui = gui
        self._ask = ask
        self._shown: dict[str, _Shown] = {}
        self._mode: Mode | None = None
        self._listed: object = None
        self._nodes: tuple[NodeId, ...] = ()
        self._graph: GraphArrays | None = None
        """Map whose nodes are listed; it is the same object as long as the map does not change."""
        self._gallery: tuple[NodeId, ...] = ()

    def show(self, snapshot: Snapshot) -> None:
        """Update the entries, and enable those that are possible now."""
        # Nodes are updated only in teleoperation, where they can be goals; in a replay they change at every moment.
        graph, gallery = snapshot.moment.graph, snapshot.gallery
        if snapshot.mode is Mode.TELEOP and (graph is not self._graph or gallery != self._gallery):
            self._graph = graph
            self._gallery = gallery
            self._nodes = gallery if len(graph.ids) > MOST_NODES else tuple(map(int, graph.ids))
        listed = snapshot.inspection.offered, snapshot.recordings, snapshot.sources, self._nodes
        if listed != self._listed:
            self._listed = listed
            self._list(dict(_entries(snapshot, self._nodes)), snapshot.mode)
        if snapshot.mode is not self._mode:
            self._mode = snapshot.mode
            for shown in self._shown.values():
                shown.handle.disabled = snapshot.mode not in shown.modes

    def _list(self, entries: Mapping[str, Entry], mode: Mode) -> None:
        for label in self._shown.keys() - entries.keys():
            self._shown.pop(label).handle.remove()
        for label, entry in entries.items():
            if label not in self._shown:
                self._shown[label] = self._added(label, entry, mode)

    def _added(self, label: str, entry: Entry, mode: Mode) -> _Shown:
        modes = WISHES[entry.action].modes
        keys = key_label(entry.action) if entry.value is None else ""
        handle = self._gui.add_command(label, description=f"Key: {keys}" if keys else None, disabled=mode not in modes)

        @handle.on_trigger
        async def _(_: viser.CommandEvent) -> None:
            self._ask(entry.action, entry.value)

        return _Shown(handle, modes)


def list_stop(gui: viser.GuiApi, stop: Callable[[], None]) -> None:
    """List the stop on one page; every page has it, with the driver's seat or without."""
    wish = WISHES[Action.STOP]
    handle = gui.add_command(f"Stop: {wish.help}", description=f"Key: {key_label(Action.STOP)}")

    @handle.on_trigger
    async def _(_: viser.CommandEvent) -> None:
        stop()


def _entries(snapshot: Snapshot, nodes: Sequence[NodeId]) -> Iterator[tuple[str, Entry]]:
    """Yield all labels with their entries, in the order of the list."""
    for action, wish in WISHES.items():
        if wish.is_listed:
            yield wish.help[0].upper() + wish.help[1:], Entry(action)
    for question in snapshot.inspection.offered:
        if question != QuestionName.NONE:
            yield f"Ask: {question}", Entry(Action.QUESTION, str(question))
    for name in snapshot.recordings:
        yield f"Open recording {name}", Entry(Action.OPEN, name)
    for name in snapshot.sources:
        yield f"Import {name}", Entry(Action.IMPORT, name)
    for node in nodes:
        yield f"Go to node {node}", Entry(Action.GOAL, int(node))
