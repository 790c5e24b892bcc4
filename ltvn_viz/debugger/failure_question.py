"""What failed: queries by cause and place, the second before each went wrong, and success over the robot's life.

Owns the page of it, and the curves of success, nodes and edges over queries. Causes and places are found in
`ltvn_core.analysis.failure_triage`, the numbers of the curves in `ltvn_core.analysis.lifelong_success`.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from ltvn_core import palette
from ltvn_core.analysis.failure_triage import (
    FailedQuery,
    FailureCluster,
    FailureMode,
    failed_queries,
    group_by_failure_mode,
    group_by_place,
)
from ltvn_core.analysis.lifelong_success import LifelongSuccess, SuccessDip, lifelong_success
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import QueryRecord
from ltvn_core.graph.deltas import BeliefUpdated, EdgeAdded, EdgePruned
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.palette import Rgb8
from ltvn_viz.debugger.charts import Axis, step_chart_svg
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.debugger.question import AnswerBuilder, Question
from ltvn_viz.session.commands import ChooseQuestion, PointAt, QuestionRequest
from ltvn_viz.session.inspection import QuestionAnswer, QuestionName, Selection
from ltvn_viz.session.overlay import EMPTY_OVERLAY, Label, Overlay, stroke

_NEXT = {
    FailureMode.WRONG_ARRIVAL: (QuestionName.EDGE, QuestionName.WHERE),
    FailureMode.LOST: (QuestionName.WHERE, QuestionName.BLAME),
    FailureMode.NO_PATH: (QuestionName.TRUTH, QuestionName.WHAT_IF),
    FailureMode.COLLISION: (QuestionName.BLAME, QuestionName.EDGE),
    FailureMode.BLOCKED: (QuestionName.EDGE, QuestionName.BLAME),
    FailureMode.FAILED_EDGE: (QuestionName.BLAME, QuestionName.EDGE),
    FailureMode.TOO_SLOW: (QuestionName.BLAME, QuestionName.EDGE),
}
"""What to ask next."""
WINDOW = 10
"""Queries over which success is counted."""
_ROWS = 10
_POINTS = 200
_DIPS = 3
_EDGES = 5


@dataclass(frozen=True, slots=True, eq=False)
class FailureSummary:
    """What there is to know about a run's queries."""

    failures: tuple[FailedQuery, ...]
    places: tuple[FailureCluster, ...]
    strip: LifelongSuccess

    @classmethod
    def of(cls, timeline: Timeline) -> "FailureSummary":
        """Look through a run; linear in its events."""
        failures = failed_queries(timeline)
        return cls(failures, group_by_place(failures), lifelong_success(timeline, WINDOW))


@dataclass(frozen=True, slots=True)
class ShowFailures(QuestionRequest):
    """List the failures of one cause."""

    only: FailureMode | None
    """None means all causes."""


class FailureQuestion(Question[ShowFailures]):
    """Tells what failed."""

    name = QuestionName.FAILURES
    word = QuestionName.FAILURES.word
    is_for_watchers = True
    about = "Failed queries by cause and place; a time leads to the second before it went wrong."

    def __init__(self) -> None:
        """Begin with all causes."""
        self._only: FailureMode | None = None
        self._known: tuple[object, FailureSummary | None] = (None, None)
        self._drawn: tuple[object, Overlay] = (None, EMPTY_OVERLAY)

    def is_offered(self, context: DebugContext) -> bool:
        """Tell whether the robot was ever sent anywhere."""
        return context.timeline.progress_before(len(context.timeline.events)).queries > 0

    def answer(self, context: DebugContext, selection: Selection) -> QuestionAnswer:
        """Show what failed up to the moment and, marked so, later; and the failure at the moment."""
        builder, findings = AnswerBuilder(), self._findings(context)
        if findings is None:
            builder.add_pending("Looking through the queries")
            return builder.build()
        if not len(findings.strip.queries):
            builder.add_text("No query has ended yet: choose a goal under “Go”, or open a recording with queries.")
            return builder.build()
        shown = [each for each in findings.failures if self._only in (None, each.failure_mode)]
        self._causes(context, findings, builder)
        now = next((each for each in shown if _covers(each, context)), None)
        if now is not None:
            _detail(context, now, builder)
        if shown:
            builder.add_table(
                ("when", "query", "cause", "near node"), [_row(context, each, builder) for each in shown[-_ROWS:]]
            )
        if len(shown) > _ROWS:
            builder.add_text(f"The last {_ROWS} of {len(shown)}; choose a cause above to see others.")
        add_lifelong_curves(context, findings.strip, builder)
        return builder.build(self._overlay(context, findings, shown, now))

    def handle_request(self, context: DebugContext, request: ShowFailures) -> None:
        """Show one cause, or all."""
        self._only = request.only

    def _findings(self, context: DebugContext) -> FailureSummary | None:
        queries, timeline = context.timeline.queries, context.timeline.copy()
        last = (queries[-1].ended, queries[-1].judged) if queries else None
        # A run that goes on is looked through again when a query is over, not with every event.
        run = context.name, context.start_s
        answer = context.in_background(("failures", *run, len(queries), last), lambda: FailureSummary.of(timeline))
        if answer is not None:
            self._known = run, answer
        return self._known[1] if self._known[0] == run else None

    def _causes(self, context: DebugContext, findings: FailureSummary, builder: AnswerBuilder) -> None:
        over = sum(end.step <= context.step for end in findings.strip.ends)
        failed = sum(not _is_later(each, context) for each in findings.failures)
        told = f"Up to now <b>{failed}</b> of <b>{over}</b> queries failed." if over else "No query is over yet."
        if over < len(findings.strip.ends):
            whole = f"{len(findings.failures)} of {len(findings.strip.ends)}"
            told += f" In the whole run {whole} queries fail; those after this moment are marked as later."
        builder.add_html(f"<div>{told}</div>")
        groups = group_by_failure_mode(findings.failures)
        links = [
            builder.request_link(f"{failure_mode} {len(group)}", ShowFailures(failure_mode))
            for failure_mode, group in groups.items()
        ]
        if self._only is not None:
            links.append(builder.request_link("show all", ShowFailures(None)))
        if links:
            builder.add_html(f"<div>{' · '.join(links)}</div>")

    def _overlay(
        self, context: DebugContext, findings: FailureSummary, shown: Sequence[FailedQuery], now: FailedQuery | None
    ) -> Overlay:
        key = findings, self._only, now
        if key != self._drawn[0]:
            self._drawn = key, _drawing(context, findings.places, shown, now)
        return self._drawn[1]


def _covers(failure: FailedQuery, context: DebugContext) -> bool:
    """Tell whether the moment lies in a failed query."""
    end = failure.query.end or failure.query.begin
    return failure.query.begin.step <= context.step <= end.step


def _is_later(failure: FailedQuery, context: DebugContext) -> bool:
    """Tell whether a query fails after the moment."""
    return (failure.query.end or failure.query.begin).step > context.step


def _row(context: DebugContext, failure: FailedQuery, builder: AnswerBuilder) -> tuple[str, ...]:
    when = builder.time_link(context.seconds(failure.instant)) + " later" * _is_later(failure, context)
    node = "–" if failure.node is None else builder.link(str(failure.node), PointAt(failure.node))
    return when, str(failure.query.id), f'<span title="{escape(failure.text)}">{failure.failure_mode}</span>', node


def _detail(context: DebugContext, failure: FailedQuery, builder: AnswerBuilder) -> None:
    query = failure.query
    wrong = builder.time_link(context.seconds(context.timeline.instant(failure.event)))
    began = builder.time_link(context.seconds(query.begin), "its beginning")
    builder.add_html(
        f"<div>Now in <b>query {query.id}</b> to node {query.goal} ({began}): {failure.failure_mode}.</div>"
    )
    builder.add_html(f"<div>{wrong} {escape(failure.text)}</div>")
    asks = " or ".join(
        f"“{builder.link(str(question), ChooseQuestion(question))}”" for question in _NEXT[failure.failure_mode]
    )
    edge = failure.edge or _last_edge(query)
    if edge is None:
        builder.add_html(f"<div>Then ask {asks}</div>")
    else:
        point = builder.link(f"edge {edge[0]} → {edge[1]}", PointAt(*edge))
        builder.add_html(f"<div>It drove {point}; point at it, then ask {asks}</div>")


def _last_edge(query: QueryRecord) -> EdgeKey | None:
    """Return the edge that was driven last, which led to where the robot thought that it had arrived."""
    driven = [(started.source, started.target) for started in (attempt.started for attempt in query.attempts)]
    return next(((source, target) for source, target in reversed(driven) if source is not None), None)


def _drawing(
    context: DebugContext, places: Sequence[FailureCluster], shown: Sequence[FailedQuery], now: FailedQuery | None
) -> Overlay:
    strokes = []
    for failure in shown:
        ends = [] if failure.edge is None else [context.pose(node) for node in failure.edge]
        if len(ends) == 2 and ends[0] is not None and ends[1] is not None:
            strokes.append(stroke(ends[0], ends[1], palette.TARGET if failure is now else palette.EDGE_REMOVED))
    nodes = {failure.node: palette.EDGE_REMOVED for failure in shown if failure.node is not None}
    if now is not None and now.node is not None:
        nodes[now.node] = palette.TARGET
    return Overlay(tuple(strokes), nodes, labels=tuple(_labels(context, places, shown)))


def _labels(context: DebugContext, places: Sequence[FailureCluster], shown: Sequence[FailedQuery]) -> list[Label]:
    kept, labels = {id(failure) for failure in shown}, []
    for place in places:
        count = sum(id(failure) in kept for failure in place.failures)
        pose = context.pose(place.nodes[0]) if place.nodes else None
        if count and pose is not None:
            labels.append(Label((float(pose[0]), float(pose[1])), f"{count} failed"))
    return labels


def add_lifelong_curves(context: DebugContext, strip: LifelongSuccess, builder: AnswerBuilder) -> None:
    """Add the curves and the dips to a page; nothing for a single query."""
    if len(strip.queries) < 2:
        return
    over = sum(end.step <= context.step for end in strip.ends)
    now = f"{100 * strip.success[over - 1]:.0f} %" if over else "–"
    builder.add_html(f"<div>Success over the last queries, now <b>{now}</b>:</div>")
    builder.add_html(_chart(strip.success, "share that arrived", palette.SOURCE, over))
    for name, counts, colour in (("nodes", strip.nodes, palette.NODE), ("edges", strip.edges, palette.PLAN)):
        builder.add_html(_chart(counts, name, colour, over))
    for dip in sorted(strip.dips, key=lambda dip: -dip.fall)[:_DIPS]:
        _dip(context, strip, dip, builder)


def _chart(values: Sequence[float] | np.ndarray, label: str, colour: Rgb8, over: int) -> str:
    """Draw one value after each query (Q,), with a line behind the last of the `over` that are over."""
    rows = np.unique(np.linspace(0, len(values) - 1, min(len(values), _POINTS)).astype(np.intp))
    points = [(float(row + 1), float(values[row])) for row in rows]
    x = Axis("queries", 1.0, float(len(values)))
    y = Axis(label, 0.0, max(1.0, float(np.max(values))))
    return step_chart_svg(points, x, y, colour=colour, now=float(over) if 0 < over < len(values) else None)


def _dip(context: DebugContext, strip: LifelongSuccess, dip: SuccessDip, builder: AnswerBuilder) -> None:
    """Say where success fell, and what happened to the map on the way down."""
    first, last = strip.queries[dip.peak], strip.queries[dip.low]
    ends = [
        builder.time_link(context.seconds(dip.before), f"query {first}"),
        builder.time_link(context.seconds(dip.after), f"query {last}"),
    ]
    within = slice(dip.peak + 1, dip.low + 1)
    counts = [int(column[within].sum()) for column in (strip.pruned, strip.edges_added, strip.nodes_added)]
    builder.add_html(
        f"<div><b>Dip:</b> success fell by {100 * dip.fall:.0f} % from {ends[0]} to {ends[1]}; meanwhile "
        f"{counts[0]} edges went, {counts[1]} edges and {counts[2]} nodes came.</div>"
    )
    touched = _touched(context, dip)
    if touched:
        links = (f"{builder.link(f'{s} → {t}', PointAt(s, t))} {escape(what)}" for (s, t), what in touched)
        builder.add_html(f"<div>Edges it touched most: {', '.join(links)}.</div>")


def _touched(context: DebugContext, dip: SuccessDip) -> list[tuple[EdgeKey, str]]:
    """Return the edges that changed most often in a dip, and how each ended; pruned ones first."""
    timeline, counts, ends = context.timeline, Counter[EdgeKey](), dict[EdgeKey, str]()
    first = timeline.change_count_before(timeline.count_until(dip.before))
    for change in timeline.changes_until(dip.after)[first:]:
        delta = change.delta
        match delta:
            case EdgePruned():
                edge, what = (delta.source, delta.target), "pruned"
            case BeliefUpdated():
                edge, what = (delta.source, delta.target), f"then p {delta.belief.p:.2f}"
            case EdgeAdded():
                edge, what = (delta.edge.source, delta.edge.target), "new"
            case _:
                continue
        counts[edge] += 1
        ends[edge] = what
    ranked = sorted(counts, key=lambda edge: (ends[edge] != "pruned", -counts[edge]))
    return [(edge, ends[edge]) for edge in ranked[:_EDGES]]
