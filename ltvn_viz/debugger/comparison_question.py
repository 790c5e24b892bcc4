"""Compare: the differences between this map and another one, or its own past, as numbers and colours.

This includes what changed since the first query: edges that are closed now or open again, and new nodes and edges.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from ltvn_core import palette
from ltvn_core.analysis.answer import Inline, Key, Step
from ltvn_core.analysis.map_comparison import EdgeDifference, MapDifference, MatchedBy
from ltvn_core.analysis.presence_forecast import PresenceState
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.world_clock import (
    clock_text,
)
from ltvn_core.errors import LtvnError
from ltvn_core.graph.deltas import Edge
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.navigation.events import Collided, Judged, QueryEnded, WorldChanged
from ltvn_core.types import NodeId
from ltvn_core.worlds import TimePassed, change_text
from ltvn_viz.debugger.background_cache import LatestAnswer
from ltvn_viz.debugger.compared_map import (
    BEFORE_FIRST_QUERY,
    ComparedMap,
    MapComparison,
    compare,
    first_query_event,
    map_before_first_query,
    map_of_moment,
    opened_map,
)
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.debugger.question import AnswerBuilder, Question, edge_link, request_link
from ltvn_viz.session.inspection import Overlay, QuestionAnswer, QuestionName, Selection, Stroke, stroke
from ltvn_viz.wishes.commands import QuestionRequest

CHOOSE_ANOTHER = "choose another"
_NAMES = 10
_ROWS = 20
_CHANGES = 12
_STROKES = 4000
_ASKS = "Name of a recording"
CLOSED = palette.TARGET
RETURNED = palette.SOURCE


@dataclass(frozen=True, slots=True)
class CompareWith(QuestionRequest):
    """Compare with the map of a recording, or with this run before its first query."""

    other: str | None
    """Name of a recording, or `BEFORE_FIRST_QUERY`; None for the list of maps to compare with."""


class ComparisonQuestion(Question[CompareWith]):
    """Shows the differences to another map."""

    name = QuestionName.COMPARE
    verb = "Compare"
    about = "This map compared with another: figures of both, and the edges that differ, the most important first."

    def __init__(self) -> None:
        """Start without another map."""
        self._other: str | None = None
        self._latest = LatestAnswer()
        self._earlier: tuple[tuple[int, Timeline], ComparedMap] | None = None

    def answer(self, context: DebugContext, selection: Selection) -> QuestionAnswer:
        """Offer recordings, or show the differences to the chosen one."""
        builder = AnswerBuilder()
        if self._other is None:
            return _offer(context, builder)
        builder.add_line(request_link(CHOOSE_ANOTHER, CompareWith(None)))
        try:
            there = self._there(context, self._other)
        except LtvnError as error:
            builder.add_line(str(error))
            return builder.build()
        if there is None:
            builder.add_pending(f"Opening {self._other}")
            return builder.build()
        question = "compare", context.name, context.revision(Collided, QueryEnded, Judged, WorldChanged), there.name
        here = map_of_moment(context)
        judge = context.known_filter
        found = self._latest(context.in_background, question, lambda: compare(here, there, judge))
        if found is None:
            builder.add_pending("Comparing")
            return builder.build()
        builder.add_behind(self._latest)
        _metrics_table(builder, found)
        return _difference(builder, found, selection)

    def handle_text(self, context: DebugContext, text: str) -> None:
        """Choose another recording by its name; raises RecordingError."""
        self.handle_request(context, CompareWith(text.strip()))

    def handle_request(self, context: DebugContext, request: CompareWith) -> None:
        """Choose the other map, or none; raises RecordingError if there is no recording with that name."""
        if request.other not in (None, BEFORE_FIRST_QUERY):
            context.library.path(request.other)
        self._other = request.other
        self._latest.forget()

    def _there(self, context: DebugContext, other: str) -> ComparedMap | None:
        if other != BEFORE_FIRST_QUERY:
            path = context.library.path(other)
            return context.in_background(("open", other, path.stat().st_mtime_ns), lambda: opened_map(path))
        key = first_query_event(context), context.timeline
        if self._earlier is None or self._earlier[0] != key:
            self._earlier = key, map_before_first_query(context)
        return self._earlier[1]


def _offer(context: DebugContext, builder: AnswerBuilder) -> QuestionAnswer:
    builder.add_line("Compare with:")
    names = [name for name in context.library.names() if name != context.name]
    if context.timeline.queries:
        builder.add_line("this run, ", request_link(BEFORE_FIRST_QUERY, CompareWith(BEFORE_FIRST_QUERY)))
    for name in names[:_NAMES]:
        builder.add_line(request_link(name, CompareWith(name)))
    if not names and not context.timeline.queries:
        builder.add_line(
            Step(
                "There is no other map yet: copy a recording or a map into the recordings folder, or drive to a goal.",
                "There is no other map in its folder: give the path of one by --text.",
            )
        )
    if len(names) > _NAMES:
        builder.add_line(f"… and {len(names) - _NAMES} more: type the name.")
    return builder.build(input_hint=_ASKS)


def _metrics_table(builder: AnswerBuilder, found: MapComparison) -> None:
    names = found.here.name or "the live run", found.there.name
    rows = [
        (what, *(tell(each) for each in found.figures))
        for what, tell in (
            ("nodes", lambda each: f"{each.nodes:,}"),
            ("edges", lambda each: f"{each.edges:,}"),
            ("pieces", lambda each: str(each.strongly_connected_components)),
            ("mean p", lambda each: "–" if each.mean_p is None else f"{each.mean_p:.3f}"),
            ("arrived, of queries", lambda each: f"{each.arrived} of {each.queries}"),
            ("reached, judged by truth", lambda each: "–" if each.reached is None else str(each.reached)),
            ("collisions", lambda each: str(each.collisions)),
        )
    ]
    builder.add_table(("", *names), rows)


def _difference(builder: AnswerBuilder, found: MapComparison, selection: Selection) -> QuestionAnswer:
    difference = found.difference
    if difference is None:
        builder.add_line("They were made in different scenes, so no edge of one is an edge of the other.")
        return builder.build()
    believed = sum(each.a is not None and each.b is not None for each in difference.differing)
    builder.add_line(
        Key(palette.EDGE_ADDED, f"only here: {len(difference.edges_only_a)}"),
        Key(palette.EDGE_REMOVED, f"only there: {len(difference.edges_only_b)}"),
        Key(palette.PLAN, f"believed differently: {believed}"),
    )
    builder.add_line(
        f"{len(difference.nodes)} nodes are in both, matched by their {difference.matched_by}; "
        f"{len(difference.nodes_only_a)} only here, {len(difference.nodes_only_b)} only there."
    )
    presence_strokes = _add_presence_changes(found, builder)
    texts = [change_text(each) for each in found.world if not isinstance(each, TimePassed)]
    if texts:
        more = f", and {len(texts) - _CHANGES} more" if len(texts) > _CHANGES else ""
        builder.add_line(f"In the world: {', '.join(texts[:_CHANGES])}{more}.")
    nodes = builder.add_selected_edge(selection)
    back = {other: node for node, other in difference.nodes.items()}
    shown = difference.differing[:_ROWS]
    shares = ("–" if each.betweenness < 5e-4 else f"{each.betweenness:.1%}" for each in shown)
    rows = [(_name(each, back), _p(each.a), _p(each.b), share) for each, share in zip(shown, shares, strict=True)]
    builder.add_table(("edge", "p here", "p there", "of all ways"), rows, len(difference.differing))
    # The map of another drive shares hardly any nodes with this one.
    new = difference.nodes_only_a[:_STROKES] if difference.matched_by is MatchedBy.ID else ()
    strokes = (*_strokes(found, difference), *presence_strokes)
    return builder.build(Overlay(strokes=strokes, nodes={**dict.fromkeys(new, palette.EDGE_ADDED), **nodes}))


def _name(each: EdgeDifference, back: Mapping[NodeId, NodeId]) -> Inline:
    """Return a link to the edge, or plain numbers of the other map's nodes if this map lacks them."""
    if each.a is not None:
        key: EdgeKey = each.a.source, each.a.target
    else:
        assert each.b is not None
        if each.b.source not in back or each.b.target not in back:
            return f"{each.b.source} → {each.b.target} there"
        key = back[each.b.source], back[each.b.target]
    return edge_link(*key)


def _p(edge: Edge | None) -> str:
    return "–" if edge is None else f"{edge.belief.p:.2f} ({edge.successes}/{edge.attempts})"


def _strokes(found: MapComparison, difference: MapDifference) -> tuple[Stroke, ...]:
    strokes = []
    for each in difference.differing[:_STROKES]:
        edge, poses = (each.a, found.here.poses) if each.a is not None else (each.b, found.there.poses)
        assert edge is not None
        if edge.source in poses and edge.target in poses:
            colour = palette.PLAN if each.a and each.b else palette.EDGE_ADDED if each.a else palette.EDGE_REMOVED
            strokes.append(stroke(poses[edge.source], poses[edge.target], colour))
    return tuple(strokes)


def _add_presence_changes(found: MapComparison, builder: AnswerBuilder) -> tuple[Stroke, ...]:
    """Report the edges that are predicted closed only in this map, and those that are open again; return a line for
    each."""
    if not (found.here.graph.presence or found.there.graph.presence):
        return ()
    closed = [each.edge for each in found.presence if each.states[0] is PresenceState.OPEN]
    returned = [each.edge for each in found.presence if each.states[1] is PresenceState.OPEN]
    builder.add_line(f"It is {clock_text(found.here.world_s)} here, and {clock_text(found.there.world_s)} there.")
    builder.add_line(
        Key(CLOSED, f"closed here, not there: {len(closed)}"), Key(RETURNED, f"open again here: {len(returned)}")
    )
    builder.add_presence_changes("p open there", "p open here", found.presence)
    poses = found.here.poses
    coloured = [*((edge, CLOSED) for edge in closed), *((edge, RETURNED) for edge in returned)]
    known = ((a, b, colour) for (a, b), colour in coloured if a in poses and b in poses)
    return tuple(stroke(poses[a], poses[b], colour) for a, b, colour in known)
