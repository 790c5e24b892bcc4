"""Manual edits: edges removed, protected and given an action, each with its undo."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import NamedTuple

from ltvn_core import palette
from ltvn_core.analysis.answer import Inline, Link, joined
from ltvn_core.analysis.manual_edits import connect_by_action, inverse_deltas, protect_edge, remove_edge
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import Instant, MapChange
from ltvn_core.errors import LtvnError, OptionError
from ltvn_core.graph import deltas as d
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.navigation.event_table import describe_delta
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.debugger.question import AnswerBuilder, Question, is_live, request_link, time_link
from ltvn_viz.session.inspection import (
    NOTHING_SELECTED,
    Overlay,
    QuestionAnswer,
    QuestionName,
    Selection,
)
from ltvn_viz.wishes.commands import Action, Ask, Command, EditMap, QuestionRequest, Seek

_ROWS = 10
_NOW_S = 1e9


class ManualEdit(NamedTuple):
    """A manual edit, and the deltas that undo it."""

    instant: Instant
    words: str
    back: tuple[d.GraphDelta, ...]
    """Empty for an edit of a node, in a recording of an earlier version."""


@dataclass(frozen=True)
class ConnectByAction(QuestionRequest):
    """Ask for the action by which the robot gets from one node to another."""

    edge: EdgeKey
    both_ways: bool = False
    """Whether the same action leads back."""


class ManualEditQuestion(Question[ConnectByAction]):
    """Changes the live map; each change can be undone."""

    name = QuestionName.HAND
    is_offered = is_live
    verb = "Change the map"
    about = "Remove, protect or restore edges of the live map while you drive. Click a node, then its neighbour."

    def __init__(self) -> None:
        """Start without a selection."""
        self._selection = NOTHING_SELECTED
        self._connecting: ConnectByAction | None = None
        self._done: tuple[tuple[Timeline, int] | None, tuple[ManualEdit, ...]] = (None, ())

    def answer(self, context: DebugContext, selection: Selection) -> QuestionAnswer:
        """Offer the edits of the selection, and the undo of earlier ones."""
        if selection != self._selection:
            self._selection = selection
            self._connecting = None
        builder = AnswerBuilder()
        input_hint = ""
        if not context.is_live:
            back = Link("go back to the robot", Ask(Action.CLOSE))
            builder.add_line("A recording cannot be changed; ", back, " to change the map.")
        elif context.timeline.count_until(context.instant) < len(context.timeline.events):
            builder.add_line("This is the past. ", Link("Go to now", Seek(_NOW_S)), " to change the map.")
        elif self._connecting is not None:
            input_hint = _ask_for_action(self._connecting, builder)
        else:
            links = [*_about_pair(context.graph, selection)]
            builder.add_line(joined(links) if links else "Click an edge, or a node and then its neighbour.")
        self._list(context, builder, undoable=context.is_live)
        return builder.build(_overlay(context, selection), input_hint)

    def handle_text(self, context: DebugContext, text: str) -> Command | None:
        """Connect two nodes by the action that was asked for. Raises OptionError, MapError."""
        if not context.is_live or self._connecting is None:
            raise OptionError("Click two nodes of the live map, and follow the link that connects them by an action.")
        connecting, self._connecting = self._connecting, None
        source, target = connecting.edge
        ways = [(source, target), (target, source)] if connecting.both_ways else [(source, target)]
        return EditMap(tuple(each for way in ways for each in connect_by_action(context.graph, *way, text)))

    def handle_request(self, context: DebugContext, request: ConnectByAction) -> None:
        """Ask for an action."""
        self._connecting = request

    def _list(self, context: DebugContext, builder: AnswerBuilder, *, undoable: bool) -> None:
        run = context.timeline, context.known_events
        if self._done[0] != run:
            self._done = run, tuple(_done(context.timeline))
        rows = []
        for each in reversed(self._done[1]):
            seconds = context.seconds(each.instant)
            undo: Inline = Link("undo", EditMap(each.back)) if undoable and each.back else ""
            rows.append((time_link(seconds), each.words, undo))
        if rows:
            builder.add_table(("when", "changed by hand", ""), rows)
        else:
            builder.add_line("Nothing was changed by hand.")


def _about_pair(graph: TopologicalGraph, selection: Selection) -> Iterator[Link]:
    pair = selection.pair
    if pair is None or not {*pair} <= graph.nodes.keys():
        return
    name = f"{pair[0]} → {pair[1]}"
    if pair in graph.edges:
        held = graph.edges[pair].protected
        yield Link(f"cut {name}", EditMap((remove_edge(graph, *pair),)))
        label = f"{'allow pruning of' if held else 'protect'} {name}"
        yield Link(label, EditMap((protect_edge(graph, *pair, protected=not held),)))
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
    strokes = () if pair is None else context.strokes([pair], palette.TARGET)
    nodes = {} if pair is None else {pair[0]: palette.SOURCE, pair[1]: palette.TARGET}
    if selection.node is not None:
        nodes.setdefault(selection.node, palette.SOURCE)
    return Overlay(strokes, nodes)
