"""Changes by hand: edges cut, held and added, nodes deleted and named, each with the way back."""

from collections.abc import Iterator, Sequence
from html import escape
from itertools import groupby
from typing import NamedTuple

from ltvn_core.analysis.hand_work import (
    add_edge,
    cut_edge,
    delete_node,
    inverse,
    mark_goal,
    protect_edge,
    rename_node,
)
from ltvn_core.analysis.records import Instant
from ltvn_core.analysis.timeline import MapChange, Timeline
from ltvn_core.config import Believing
from ltvn_core.errors import LtvnError, OptionError
from ltvn_core.graph import deltas as d
from ltvn_core.graph.topograph import TopologicalGraph
from ltvn_core.types import NodeId
from ltvn_viz import palette
from ltvn_viz.commands import ChangeMap, CloseRecording, Command, Seek
from ltvn_viz.why.case import Case
from ltvn_viz.why.overlay import Label, Overlay, stroke
from ltvn_viz.why.tool import NOWHERE, Page, Selection, ToolView

_ROWS = 10
_NAME = "name"
_NOW_S = 1e9


class Done(NamedTuple):
    """What a person changed at once, and what takes it back."""

    instant: Instant
    words: str
    back: tuple[d.GraphDelta, ...]


class HandTool:
    """Changes the live map; whatever it does can be undone."""

    about = "Change the live map while you drive. Click a node, or one and then another to join or part them."

    def __init__(self) -> None:
        """Begin with nothing selected."""
        self._selection = NOWHERE
        self._done: tuple[Timeline, tuple[Done, ...]] = (Timeline.of(()), ())

    def look(self, case: Case, selection: Selection) -> ToolView:
        """Offer what can be done with the selection, and what was done to be undone."""
        self._selection, page = selection, Page()
        asks = ""
        if not case.is_live:
            back = page.link("go back to the robot", CloseRecording())
            page.html(f"<div>A recording cannot be changed; {back} to change the map.</div>")
        elif not _is_now(case):
            page.html(f"<div>This is the past. {page.link('Go to now', Seek(_NOW_S))} to change the map.</div>")
        else:
            asks = self._offers(case, selection, page)
        self._list(case, page, undoable=case.is_live)
        return page.view(_overlay(case, selection), asks)

    def told(self, case: Case, text: str) -> Command | None:
        """Name the selected node. Raises OptionError, MapError."""
        node, words = self._selection.node, text.split()
        if not case.is_live or not words or words[0].lower() != _NAME:
            raise OptionError("Click a node of the live map and write for instance: name kitchen.")
        if node is None:
            raise OptionError("Click the node first that is to have this name.")
        return ChangeMap((rename_node(case.graph, node, " ".join(words[1:])),))

    @staticmethod
    def _offers(case: Case, selection: Selection, page: Page) -> str:
        graph = case.graph
        node = selection.node if selection.node in graph.nodes else None
        links = [*_about_pair(graph, selection, case.method.believing, page)]
        links += () if node is None else _about_node(graph, node, page)
        if links:
            page.html(f"<div>{' · '.join(links)}</div>")
        else:
            page.line("Click a node in the scene.")
        return "" if node is None else f"{_NAME} … (of node {node})"

    def _list(self, case: Case, page: Page, *, undoable: bool) -> None:
        if self._done[0] is not case.timeline:
            self._done = case.timeline, tuple(_done(case.timeline))
        rows = []
        for each in reversed(self._done[1]):
            seconds = case.seconds(each.instant)
            undo = page.link("undo", ChangeMap(each.back)) if undoable else ""
            rows.append((page.link(f"{seconds:.1f} s", Seek(seconds)), escape(each.words), undo))
        if rows:
            page.table(("when", "changed by hand", ""), rows)
        else:
            page.line("Nothing was changed by hand.")


def _is_now(case: Case) -> bool:
    return case.timeline.count_until(case.instant) == len(case.timeline.events)


def _about_pair(graph: TopologicalGraph, selection: Selection, believing: Believing, page: Page) -> Iterator[str]:
    pair = selection.pair
    if pair is None or not {*pair} <= graph.nodes.keys():
        return
    name = f"{pair[0]} → {pair[1]}"
    if pair in graph.edges:
        held = graph.edges[pair].protected
        yield page.link(f"cut {name}", ChangeMap((cut_edge(graph, *pair),)))
        label = f"{'allow pruning of' if held else 'protect'} {name}"
        yield page.link(label, ChangeMap((protect_edge(graph, *pair, protected=not held),)))
    else:
        try:
            yield page.link(f"add {name}", ChangeMap((add_edge(graph, *pair, believing),)))
        except OptionError as error:
            page.line(str(error))


def _about_node(graph: TopologicalGraph, node: NodeId, page: Page) -> Iterator[str]:
    goal = graph.nodes[node].goal
    label = f"{node} is no goal" if goal else f"mark {node} as a goal"
    yield page.link(label, ChangeMap((mark_goal(graph, node, goal=not goal),)))
    yield page.link(f"delete {node}", ChangeMap((delete_node(graph, node),)))


def _done(timeline: Timeline) -> Iterator[Done]:
    """Yield the latest changes by hand of the present map, those of one step as one; linear in its changes."""
    changes = timeline.changes[timeline.epochs[-1] :] if timeline.epochs else ()
    by_hand = [k for k, change in enumerate(changes) if change.delta.cause is d.Cause.HAND]
    steps = sorted({changes[k].instant.step for k in by_hand})[-_ROWS:]
    if not steps:
        return
    first = next(k for k in by_hand if changes[k].instant.step == steps[0])
    graph = timeline.graph_before(changes[first].event)
    for _, group in groupby(changes[first:], key=lambda each: (each.instant.step, each.delta.cause)):
        undone = _followed(graph, tuple(group))
        if undone is not None:
            yield undone


def _followed(graph: TopologicalGraph, changes: Sequence[MapChange]) -> Done | None:
    """Let a map follow changes; return how to take them back if they were made by hand and fit the map."""
    backs: list[tuple[d.GraphDelta, ...]] = []
    for change in changes:
        try:
            backs.append(inverse(change.delta, graph))
            graph.apply(change.delta)
        except LtvnError:
            return None
    if changes[0].delta.cause is not d.Cause.HAND:
        return None
    words = _words(changes[0].delta) + (f" and {len(changes) - 1} more" if len(changes) > 1 else "")
    return Done(changes[0].instant, words, tuple(delta for back in reversed(backs) for delta in back))


def _words(delta: d.GraphDelta) -> str:
    match delta:
        case d.NodeAdded(node):
            return f"node {node.id} added"
        case d.NodeDropped(node):
            return f"node {node} deleted"
        case d.EdgeAdded(edge):
            return f"edge {edge.source} → {edge.target} added"
        case d.EdgePruned(source, target):
            return f"edge {source} → {target} cut"
        case d.EdgeProtected(source, target, protected):
            return f"edge {source} → {target} {'protected' if protected else 'no more protected'}"
        case d.BeliefUpdated(source, target, belief):
            return f"p of edge {source} → {target} set to {belief.p:.2f}"
        case d.NodeNamed(node, name, goal):
            called = f"called “{name}”" if name else "without a name"
            return f"node {node} {called}{', a goal' if goal else ''}"
    return "images of the reserve changed"


def _overlay(case: Case, selection: Selection) -> Overlay:
    pair = selection.pair
    ends = () if pair is None else tuple(pose for pose in map(case.pose, pair) if pose is not None)
    strokes = (stroke(*ends, palette.TARGET),) if len(ends) == 2 else ()
    nodes = {} if pair is None else {pair[0]: palette.SOURCE, pair[1]: palette.TARGET}
    if selection.node is not None:
        nodes.setdefault(selection.node, palette.SOURCE)
    return Overlay(strokes, nodes, labels=tuple(_labels(case)))


def _labels(case: Case) -> Iterator[Label]:
    for node in case.graph.nodes.values():
        pose = case.pose(node.id) if node.name or node.goal else None
        if pose is not None:
            text = f"{'★ ' if node.goal else ''}{node.name or node.id}"
            yield Label((float(pose[0]), float(pose[1])), text)
