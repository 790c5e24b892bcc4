"""Compare: this map against another one, or against what it was before the first query, with figures and in colours."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias, assert_never

from ltvn_core import palette
from ltvn_core.analysis.map_comparison import EdgeDifference, MapDifference, MapMetrics, compare_maps, map_metrics
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.errors import LtvnError
from ltvn_core.graph.deltas import Edge
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.navigation.events import Judged, QueryEnded, StampedEvent
from ltvn_core.recording.reader import Recording
from ltvn_core.types import NodeId, Pose
from ltvn_viz.debugger.background_cache import LatestAnswer
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.debugger.question import AnswerBuilder, Question
from ltvn_viz.debugger.svg_figures import legend_item
from ltvn_viz.session.commands import PointAt, QuestionRequest
from ltvn_viz.session.inspection import QuestionAnswer, QuestionName, Selection
from ltvn_viz.session.overlay import Overlay, Stroke, stroke

BEFORE_FIRST_QUERY = "before its first query"
CHOOSE_ANOTHER = "choose another"
_NAMES, _ROWS, _STROKES = 10, 20, 4000
_ASKS = "Name of a recording"


@dataclass(frozen=True, slots=True)
class CompareWithStart(QuestionRequest):
    """Compare with this run before its first query."""


@dataclass(frozen=True, slots=True)
class CompareWithRecording(QuestionRequest):
    """Compare with the map of another recording."""

    name: str


@dataclass(frozen=True, slots=True)
class ChooseAnother(QuestionRequest):
    """Go back to the list of what to compare with."""


ComparisonRequest: TypeAlias = CompareWithStart | CompareWithRecording | ChooseAnother


@dataclass(frozen=True, eq=False)
class ComparedMap:
    """One of the two maps, and what happened to it."""

    name: str
    scene: str
    graph: TopologicalGraph
    events: Sequence[StampedEvent]
    poses: Mapping[NodeId, Pose]


@dataclass(frozen=True, eq=False)
class MapComparison:
    """The answer."""

    here: ComparedMap
    there: ComparedMap
    figures: tuple[MapMetrics, MapMetrics]
    difference: MapDifference | None
    """None across scenes."""


class ComparisonQuestion(Question[ComparisonRequest]):
    """Shows what is different in another map."""

    name = QuestionName.COMPARE
    word = QuestionName.COMPARE.word
    about = "This map against another: figures of both, and the edges that differ, those that matter most first."

    def __init__(self) -> None:
        """Compare with nothing yet."""
        self._other: CompareWithStart | CompareWithRecording | None = None
        self._latest = LatestAnswer()
        self._start: tuple[Timeline, int, ComparedMap] | None = None

    def answer(self, context: DebugContext, selection: Selection) -> QuestionAnswer:
        """Offer recordings, or show what is different in the chosen one."""
        builder = AnswerBuilder()
        if self._other is None:
            return _offer(context, builder)
        builder.add_html(f"<div>{builder.request_link(CHOOSE_ANOTHER, ChooseAnother())}</div>")
        try:
            there = self._there(context, self._other)
        except LtvnError as error:
            builder.add_text(str(error))
            return builder.build()
        if there is None:
            builder.add_pending(f"Opening {_title(self._other)}")
            return builder.build()
        here = (
            context.name,
            context.scene,
            context.graph,
            context.timeline.events[: context.timeline.count_until(context.instant)],
        )
        poses = _poses(context, context.graph)
        question = ("compare", context.name, context.revision(QueryEnded, Judged), there.name)
        found = self._latest(context.in_background, question, lambda: _compared(ComparedMap(*here, poses), there))
        if found is None:
            builder.add_pending("Comparing")
            return builder.build()
        _metrics_table(builder, found)
        return _difference(builder, found, selection)

    def handle_text(self, context: DebugContext, text: str) -> None:
        """Take the name of the other recording; raises RecordingError if there is none of that name."""
        self.handle_request(context, CompareWithRecording(text.strip()))

    def handle_request(self, context: DebugContext, request: ComparisonRequest) -> None:
        """Take the other map, or none; raises RecordingError if there is no recording of that name."""
        match request:
            case CompareWithRecording(name):
                context.library.path(name)
                self._other = request
            case CompareWithStart():
                self._other = request
            case ChooseAnother():
                self._other = None
            case _:
                assert_never(request)
        self._latest.forget()

    def _there(self, context: DebugContext, other: CompareWithStart | CompareWithRecording) -> ComparedMap | None:
        if isinstance(other, CompareWithStart):
            run = context.timeline, _first_query_event(context.timeline)
            if self._start is None or self._start[:2] != run:
                self._start = *run, _before(context)
            return self._start[2]
        path = context.library.path(other.name)
        return context.in_background(("open", other.name, path.stat().st_mtime_ns), lambda: _opened(path))


def _title(other: CompareWithStart | CompareWithRecording) -> str:
    return other.name if isinstance(other, CompareWithRecording) else f"this run, {BEFORE_FIRST_QUERY}"


def _offer(context: DebugContext, builder: AnswerBuilder) -> QuestionAnswer:
    builder.add_text("Compare with:")
    names = [name for name in context.library.names() if name != context.name]
    offered = (
        [f"this run, {builder.request_link(BEFORE_FIRST_QUERY, CompareWithStart())}"]
        if context.timeline.queries
        else []
    )
    offered += [builder.request_link(name, CompareWithRecording(name)) for name in names[:_NAMES]]
    for each in offered:
        builder.add_html(f"<div>{each}</div>")
    if not offered:
        builder.add_text(
            "There is nothing yet: copy a recording or a map into the recordings folder, or drive to a goal."
        )
    if len(names) > _NAMES:
        builder.add_text(f"… and {len(names) - _NAMES} more: type the name.")
    return builder.build(input_hint=_ASKS)


def _before(context: DebugContext) -> ComparedMap:
    first = _first_query_event(context.timeline)
    graph = context.timeline.graph_before(first)
    return ComparedMap(
        BEFORE_FIRST_QUERY, context.scene, graph, context.timeline.events[:first], _poses(context, graph)
    )


def _first_query_event(timeline: Timeline) -> int:
    """Return the number of the event with which the first query begins, or of the next event to come."""
    return timeline.queries[0].first if timeline.queries else len(timeline.events)


def _opened(path: Path) -> ComparedMap:
    recording = Recording.open(path)
    poses = recording.poses
    drawn = poses.odometry if poses.exact is None else poses.exact
    where = dict(zip(poses.steps.tolist(), drawn, strict=True))
    return ComparedMap(path.name, recording.meta.scene, recording.final_graph(), recording.events, where)


def _poses(context: DebugContext, graph: TopologicalGraph) -> dict[NodeId, Pose]:
    return {node: pose for node in graph.nodes if (pose := context.pose(node)) is not None}


def _compared(here: ComparedMap, there: ComparedMap) -> MapComparison:
    both = map_metrics(here.graph, here.events), map_metrics(there.graph, there.events)
    difference = None
    if here.scene == there.scene:
        difference = compare_maps(here.graph, there.graph, poses_a=here.poses, poses_b=there.poses)
    return MapComparison(here, there, both, difference)


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
        builder.add_text("They were made in different scenes, so no edge of one is an edge of the other.")
        return builder.build()
    believed = sum(each.a is not None and each.b is not None for each in difference.differing)
    builder.add_html(
        f"<div>{legend_item(palette.EDGE_ADDED, f'only here: {len(difference.edges_only_a)}')} "
        f"{legend_item(palette.EDGE_REMOVED, f'only there: {len(difference.edges_only_b)}')} "
        f"{legend_item(palette.PLAN, f'believed differently: {believed}')}</div>"
    )
    builder.add_text(f"{len(difference.nodes)} nodes are in both, known by their {difference.matched_by}.")
    nodes = builder.add_selected_edge(selection)
    if difference.differing:
        back = {other: node for node, other in difference.nodes.items()}
        rows = [_row(builder, each, back) for each in difference.differing[:_ROWS]]
        builder.add_table(("edge", "p here", "p there", "of all ways"), rows)
        if len(difference.differing) > _ROWS:
            builder.add_text(f"… and {len(difference.differing) - _ROWS} more that matter less.")
    return builder.build(Overlay(strokes=_strokes(found, difference), nodes=nodes))


def _row(builder: AnswerBuilder, each: EdgeDifference, back: Mapping[NodeId, NodeId]) -> tuple[str, ...]:
    shares = "–" if each.betweenness < 5e-4 else f"{each.betweenness:.1%}"
    return _name(builder, each, back), _p(each.a), _p(each.b), shares


def _name(builder: AnswerBuilder, each: EdgeDifference, back: Mapping[NodeId, NodeId]) -> str:
    """Return a link to the edge, or plain numbers of the other map where this one has no such nodes."""
    if each.a is not None:
        key: EdgeKey = each.a.source, each.a.target
    else:
        assert each.b is not None
        if each.b.source not in back or each.b.target not in back:
            return f"{each.b.source} → {each.b.target} there"
        key = back[each.b.source], back[each.b.target]
    return builder.link(f"{key[0]} → {key[1]}", PointAt(*key))


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
