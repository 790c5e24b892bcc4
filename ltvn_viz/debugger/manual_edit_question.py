"""Manual edits: edges pruned, protected, added and given an action, nodes deleted and named, each with its undo."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import NamedTuple

from ltvn_core import palette
from ltvn_core.analysis.answer import Inline, Link, joined
from ltvn_core.analysis.event_text import describe_delta
from ltvn_core.analysis.manual_edits import (
    add_edge,
    connect_by_action,
    delete_node,
    inverse_deltas,
    mark_goal,
    protect_edge,
    remove_edge,
    rename_node,
)
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import Instant, MapChange
from ltvn_core.config import BeliefConfig
from ltvn_core.errors import LtvnError, OptionError
from ltvn_core.graph import deltas as d
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.types import NodeId
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.debugger.question import AnswerBuilder, Question, request_link, time_link
from ltvn_viz.session.inspection import (
    NOTHING_SELECTED,
    Label,
    Overlay,
    QuestionAnswer,
    QuestionName,
    Selection,
    stroke,
)
from ltvn_viz.wishes.commands import CloseRecording, Command, EditMap, QuestionRequest, Seek

_ROWS = 10
_NAME = "name"
_NOW_S = 1e9


class ManualEdit(NamedTuple):
    """A manual edit, and the deltas that undo it."""

    instant: Instant
    words: str
    back: tuple[d.GraphDelta, ...]


@dataclass(frozen=True)
class ConnectByAction(QuestionRequest):
    """Ask for the action by which the robot gets from one node to another."""

    edge: EdgeKey
    both_ways: bool = False
    """Whether the same action leads back."""


class ManualEditQuestion(Question[ConnectByAction]):
    """Changes the live map; each change can be undone."""

    name = QuestionName.HAND
    word = QuestionName.HAND.word
    verb = "Change the map"
    about = "Change the live map while you drive. Click a node, or two nodes to join or separate them."

    def __init__(self) -> None:
        """Start without a selection."""
        self._selection = NOTHING_SELECTED
        self._connecting: ConnectByAction | None = None
        self._done: tuple[tuple[Timeline, int] | None, tuple[ManualEdit, ...]] = (None, ())

    def is_offered(self, context: DebugContext) -> bool:
        """Tell whether the live map is on show."""
        return context.is_live

    def answer(self, context: DebugContext, selection: Selection) -> QuestionAnswer:
        """Offer the edits of the selection, and the undo of earlier ones."""
        if selection != self._selection:
            self._selection = selection
            self._connecting = None
        builder = AnswerBuilder()
        input_hint = ""
        if not context.is_live:
            back = Link("go back to the robot", CloseRecording())
            builder.add_line("A recording cannot be changed; ", back, " to change the map.")
        elif not _is_now(context):
            builder.add_line("This is the past. ", Link("Go to now", Seek(_NOW_S)), " to change the map.")
        elif self._connecting is not None:
            input_hint = _ask_for_action(self._connecting, builder)
        else:
            input_hint = self._offers(context, selection, builder)
        self._list(context, builder, undoable=context.is_live)
        return builder.build(_overlay(context, selection), input_hint)

    def handle_text(self, context: DebugContext, text: str) -> Command | None:
        """Connect two nodes by the action that was asked for, else name the selected node.

        Raises OptionError, MapError.
        """
        if context.is_live and self._connecting is not None:
            connecting, self._connecting = self._connecting, None
            return EditMap(_connection(context.graph, connecting, text))
        node = self._selection.node
        words = text.split()
        if not context.is_live or not words or words[0].lower() != _NAME:
            raise OptionError("Click a node of the live map and write for instance: name kitchen.")
        if node is None:
            raise OptionError("First click the node that shall have this name.")
        return EditMap((rename_node(context.graph, node, " ".join(words[1:])),))

    def handle_request(self, context: DebugContext, request: ConnectByAction) -> None:
        """Ask for an action."""
        self._connecting = request

    @staticmethod
    def _offers(context: DebugContext, selection: Selection, builder: AnswerBuilder) -> str:
        graph = context.graph
        node = selection.node if selection.node in graph.nodes else None
        links = [*_about_pair(graph, selection, context.method.believing, builder)]
        links += () if node is None else _about_node(graph, node)
        if links:
            builder.add_line(joined(links))
        else:
            builder.add_line("Click a node in the scene.")
        return "" if node is None else f"{_NAME} … (of node {node})"

    def _list(self, context: DebugContext, builder: AnswerBuilder, *, undoable: bool) -> None:
        run = context.timeline, context.known_events
        if self._done[0] != run:
            self._done = run, tuple(_done(context.timeline))
        rows = []
        for each in reversed(self._done[1]):
            seconds = context.seconds(each.instant)
            undo: Inline = Link("undo", EditMap(each.back)) if undoable else ""
            rows.append((time_link(seconds), each.words, undo))
        if rows:
            builder.add_table(("when", "changed by hand", ""), rows)
        else:
            builder.add_line("Nothing was changed by hand.")


def _is_now(context: DebugContext) -> bool:
    return context.timeline.count_until(context.instant) == len(context.timeline.events)


def _about_pair(
    graph: TopologicalGraph, selection: Selection, believing: BeliefConfig, builder: AnswerBuilder
) -> Iterator[Link]:
    pair = selection.pair
    if pair is None or not {*pair} <= graph.nodes.keys():
        return
    name = f"{pair[0]} → {pair[1]}"
    if pair in graph.edges:
        held = graph.edges[pair].protected
        yield Link(f"cut {name}", EditMap((remove_edge(graph, *pair),)))
        label = f"{'allow pruning of' if held else 'protect'} {name}"
        yield Link(label, EditMap((protect_edge(graph, *pair, protected=not held),)))
    else:
        try:
            yield Link(f"add {name}", EditMap((add_edge(graph, *pair, believing),)))
        except OptionError as error:
            builder.add_line(str(error))
    yield request_link(f"connect {name} by an action", ConnectByAction(pair))


def _ask_for_action(connecting: ConnectByAction, builder: AnswerBuilder) -> str:
    """Explain what to write, and return the hint in the text field."""
    source, target = connecting.edge
    both = connecting.both_ways
    builder.add_line(
        f"What must somebody do to bring the robot from node {source} to node {target}? ",
        "For instance: Take the lift to floor 2. The robot waits until it is done.",
    )
    label = f"{'☑' if both else '☐'} both ways"
    builder.add_line(request_link(label, ConnectByAction(connecting.edge, both_ways=not both)))
    return f"Action from {source} to {target}"


def _connection(graph: TopologicalGraph, connecting: ConnectByAction, action: str) -> tuple[d.GraphDelta, ...]:
    source, target = connecting.edge
    there = connect_by_action(graph, source, target, action)
    return (*there, *connect_by_action(graph, target, source, action)) if connecting.both_ways else there


def _about_node(graph: TopologicalGraph, node: NodeId) -> Iterator[Link]:
    goal = graph.nodes[node].goal
    label = f"unmark {node} as a goal" if goal else f"mark {node} as a goal"
    yield Link(label, EditMap((mark_goal(graph, node, goal=not goal),)))
    yield Link(f"delete {node}", EditMap((delete_node(graph, node),)))


def _done(timeline: Timeline) -> Iterator[ManualEdit]:
    """Yield the latest manual edits of the present map, one per step; linear in the map's changes."""
    changes = timeline.changes[timeline.epochs[-1] :] if timeline.epochs else ()
    by_hand = [k for k, change in enumerate(changes) if change.delta.cause is d.Cause.HAND]
    steps = sorted({changes[k].instant.step for k in by_hand})[-_ROWS:]
    if not steps:
        return
    first = next(k for k in by_hand if changes[k].instant.step == steps[0])
    graph = timeline.graph_before(changes[first].event)
    for _, group in groupby(changes[first:], key=lambda each: (each.instant.step, each.delta.cause)):
        undone = _replayed(graph, tuple(group))
        if undone is not None:
            yield undone


def _replayed(graph: TopologicalGraph, changes: Sequence[MapChange]) -> ManualEdit | None:
    """Apply changes to a map; return them with their inverse if a person made them and they fit the map."""
    backs: list[tuple[d.GraphDelta, ...]] = []
    for change in changes:
        try:
            backs.append(inverse_deltas(change.delta, graph))
            graph.apply(change.delta)
        except LtvnError:
            return None
    if changes[0].delta.cause is not d.Cause.HAND:
        return None
    words = describe_delta(changes[0].delta).text + (f" and {len(changes) - 1} more" if len(changes) > 1 else "")
    return ManualEdit(changes[0].instant, words, tuple(delta for back in reversed(backs) for delta in back))


def _overlay(context: DebugContext, selection: Selection) -> Overlay:
    pair = selection.pair
    ends = () if pair is None else tuple(pose for pose in map(context.pose, pair) if pose is not None)
    strokes = (stroke(*ends, palette.TARGET),) if len(ends) == 2 else ()
    nodes = {} if pair is None else {pair[0]: palette.SOURCE, pair[1]: palette.TARGET}
    if selection.node is not None:
        nodes.setdefault(selection.node, palette.SOURCE)
    return Overlay(strokes, nodes, labels=tuple(_labels(context)))


def _labels(context: DebugContext) -> Iterator[Label]:
    for node in context.graph.nodes.values():
        pose = context.pose(node.id) if node.name or node.goal else None
        if pose is not None:
            text = f"{'★ ' if node.goal else ''}{node.name or node.id}"
            yield Label((float(pose[0]), float(pose[1])), text)
