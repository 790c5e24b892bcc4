"""Failures up to the moment: queries by cause and place, the second before each failure, and success over time.

Owns the layout of the answer, and the curves of success, nodes and edges over queries. Causes and places come from
`ltvn_core.analysis.failure_triage`, the numbers of the curves from `ltvn_core.analysis.lifelong_success`.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ltvn_core import palette
from ltvn_core.analysis.answer import Axis, Hint, Inline, Link, Step, StepChart, Strong, joined
from ltvn_core.analysis.failure_triage import (
    FailedQuery,
    FailureMode,
    failed_queries,
    group_by_failure_mode,
    group_by_place,
)
from ltvn_core.analysis.lifelong_success import LifelongSuccess, SuccessDip, lifelong_success
from ltvn_core.analysis.map_findings import MapFinding, contradicted_edges, map_gap
from ltvn_core.graph.deltas import BeliefUpdated, EdgeAdded, EdgePruned
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.navigation.events import Outcome
from ltvn_core.palette import Rgb8
from ltvn_core.types import FrameId
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.debugger.question import AnswerBuilder, Question, edge_link, has_query, request_link, time_link
from ltvn_viz.session.inspection import Label, Overlay, QuestionAnswer, QuestionName, Selection
from ltvn_viz.wishes.commands import Action, Ask, PointAt, QuestionRequest

_NEXT = {
    FailureMode.ODOMETRY: (QuestionName.WHERE, QuestionName.EDGE),
    FailureMode.FALSE_EDGE: (QuestionName.EDGE, QuestionName.WHERE, QuestionName.DECISIONS),
    FailureMode.OBSTRUCTED: (QuestionName.EDGE, QuestionName.DECISIONS),
    FailureMode.NOT_RECOGNISED: (QuestionName.WHERE, QuestionName.TRUTH, QuestionName.WHAT_IF),
}
"""Follow-up questions."""
WINDOW = 10
"""Number of queries over which success is averaged."""
_ROWS = 10
_MAP_ROWS = 6
_HEAD = ("query", "cause", "near node")
_POINTS = 200
_DIPS = 3
_EDGES = 5
_HOW_TO_SEE_QUERIES = Step(
    ": choose a goal under “Go”, or open a recording with queries.", ": ask --at a later time, or about another file."
)


@dataclass(frozen=True, slots=True, eq=False)
class FailureSummary:
    """A summary of the queries of a run."""

    failures: tuple[FailedQuery, ...]
    strip: LifelongSuccess

    def until(self, step: FrameId) -> "FailureSummary":
        """Return the summary up to a step."""
        failures = tuple(each for each in self.failures if (each.query.end or each.query.begin).step <= step)
        return FailureSummary(failures, self.strip.until(step))


@dataclass(frozen=True, slots=True)
class ShowFailures(QuestionRequest):
    """List the failures of one cause."""

    only: FailureMode | None
    """The only cause to list; None means all causes."""


class FailureQuestion(Question[ShowFailures]):
    """Shows failed queries."""

    name = QuestionName.FAILURES
    is_offered = has_query
    about = "Failed queries by cause and place; a time shows the second before the failure."

    def __init__(self) -> None:
        """List the failures of all causes until one is chosen."""
        self._only: FailureMode | None = None
        self._known: tuple[object, FailureSummary | None] = (None, None)

    def answer(self, context: DebugContext, selection: Selection) -> QuestionAnswer:
        """Show the failures up to the moment, the last one first; a separate line mentions later failures."""
        builder = AnswerBuilder()
        findings = self._findings(context)
        if findings is None:
            builder.add_pending("Searching the queries")
            return builder.build()
        if not len(findings.strip.queries):
            builder.add_line("No query has ended yet", _HOW_TO_SEE_QUERIES)
            return builder.build()
        if selection.query is not None:
            _one_query(context, selection.query, findings.failures, builder)
            return builder.build()
        known = findings.until(context.step)
        shown = [each for each in known.failures if self._only in (None, each.failure_mode)]
        self._causes(known, builder)
        ends = builder.add_selected_edge(selection)
        later = findings.failures[len(known.failures) :]
        is_failing = bool(later) and later[0].query.begin.step <= context.step
        if shown and not is_failing:
            _detail(context, shown[-1], builder)
        builder.add_table(("when", *_HEAD), [_row(context, each) for each in shown[-_ROWS:]])
        if len(shown) > _ROWS:
            others = Step("choose a cause above to see others.", "--query NUMBER speaks of one alone.")
            builder.add_line(f"The last {_ROWS} of {len(shown)}; ", others)
        add_lifelong_curves(context, known.strip, builder)
        if later:
            _later(context, later, builder)
        drawn = _drawing(context, shown)
        return builder.build(replace(drawn, nodes={**drawn.nodes, **ends}))

    def handle_request(self, context: DebugContext, request: ShowFailures) -> None:
        """Show one cause, or all causes."""
        self._only = request.only

    def _findings(self, context: DebugContext) -> FailureSummary | None:
        queries = context.timeline.queries
        timeline = context.timeline.copy()
        last = (queries[-1].ended, queries[-1].judged) if queries else None
        # During a run, the failures are searched again after each query, not after each event.
        run = context.name, context.start_s
        answer = context.in_background(
            ("failures", *run, len(queries), last),
            lambda: FailureSummary(failed_queries(timeline), lifelong_success(timeline, WINDOW)),
        )
        if answer is not None:
            self._known = run, answer
        return self._known[1] if self._known[0] == run else None

    def _causes(self, known: FailureSummary, builder: AnswerBuilder) -> None:
        over = len(known.strip.ends)
        if over:
            failed = len(known.failures)
            queries = "query" if over == 1 else "queries"
            builder.add_line("Up to now ", Strong(f"{failed}"), " of ", Strong(f"{over}"), f" {queries} failed.")
        else:
            builder.add_line("No query has ended yet.")
        links = [
            request_link(f"{failure_mode} {len(group)}", ShowFailures(failure_mode))
            for failure_mode, group in group_by_failure_mode(known.failures).items()
        ]
        if self._only is not None:
            links.append(request_link("show all", ShowFailures(None)))
        if links:
            builder.add_line(joined(links))


def _row(context: DebugContext, failure: FailedQuery, *, is_later: bool = False) -> tuple[Inline, ...]:
    node = "–" if failure.node is None else Link(str(failure.node), PointAt(failure.node))
    judged = failure.query.judged
    missed = f", {judged.position_error_m:.2f} m off" if failure.query.outcome is Outcome.ARRIVED and judged else ""
    cause = Hint(f"{failure.ending}{missed}: {failure.failure_mode}", "" if is_later else failure.text)
    return time_link(context.seconds(failure.instant)), str(failure.query.id), cause, node


def _one_query(context: DebugContext, number: int, failures: Sequence[FailedQuery], builder: AnswerBuilder) -> None:
    """Tell how one query ended."""
    query = context.query(number)
    if query is None:
        builder.add_line("Query ", Strong(str(number)), " has not begun at this moment.")
        return
    failure = next((each for each in failures if each.query.id == number), None)
    if failure is not None and (query.end or query.begin).step <= context.step:
        _detail(context, failure, builder, "Failed: ")
        return
    began: list[Inline] = [Strong(f"Query {number}"), f" to node {query.goal}, begun at "]
    began.append(time_link(context.seconds(query.begin)))
    if query.end is None or query.end.step > context.step:
        builder.add_line(began, ", has not ended at this moment.")
    else:
        builder.add_line(
            began, ", did not fail: it ended at ", time_link(context.seconds(query.end)), f", {query.outcome}."
        )


def _detail(
    context: DebugContext, failure: FailedQuery, builder: AnswerBuilder, heading: str = "Last failed: "
) -> None:
    """Explain the failure of a query, and offer questions about it."""
    query = failure.query
    wrong = time_link(context.seconds(context.timeline.instant(failure.event)))
    began = time_link(context.seconds(query.begin))
    failed = Strong(f"query {query.id}")
    builder.add_line(
        heading, failed, f" to node {query.goal}, begun at ", began, f": {failure.ending}, {failure.failure_mode}."
    )
    builder.add_line(wrong, f" {failure.text}")
    builder.add_line(_what_to_ask(failure, "It drove"))
    _add_map_faults(context, failure, builder)


def _later(context: DebugContext, later: Sequence[FailedQuery], builder: AnswerBuilder) -> None:
    """Add a separate line and table about failures after the moment: whoever goes back in time still has them."""
    failure = later[0]
    run = "run" if context.is_live else "recording"
    named = f"query {failure.query.id} fails, {failure.ending}, {failure.failure_mode}, from "
    when = time_link(context.seconds(failure.instant))
    builder.add_line(f"Later in this {run}: {named}", when, " on. ", _what_to_ask(failure, "It drives"))
    builder.add_table(("later", *_HEAD), [_row(context, each, is_later=True) for each in later[:_ROWS]], len(later))


def _what_to_ask(failure: FailedQuery, drove: str) -> list[Inline]:
    """Return the driven edge after the words `drove`, and links to questions about it."""
    # The last driven edge led to the place where the robot reported its arrival.
    driven = [each.started for each in failure.query.attempts]
    last = next(((each.source, each.target) for each in reversed(driven) if each.source is not None), None)
    edge = failure.edge or last
    asking: list[Inline] = ["Ask “"]
    if edge is not None:
        typed = f": --edge {edge[0]} {edge[1]}; ask “"
        link = Link(f"edge {edge[0]} → {edge[1]}", PointAt(*edge))
        asking = [f"{drove} ", link, Step(": select it, then ask “", typed)]
    questions = _NEXT[failure.failure_mode]
    links = [Link(str(question), Ask(Action.QUESTION, question)) for question in questions]
    words = " or ".join(f"--ask {question.word}" for question in questions)
    return [*asking, *joined(links, "” or “"), Step("”.", f"” ({words}).")]


def _drawing(context: DebugContext, shown: Sequence[FailedQuery]) -> Overlay:
    """Mark the places where queries failed, the last one in another colour."""
    last = shown[-1] if shown else None
    strokes = [
        line
        for failure in shown
        if failure.edge is not None
        for line in context.strokes([failure.edge], palette.TARGET if failure is last else palette.EDGE_REMOVED)
    ]
    nodes = {failure.node: palette.EDGE_REMOVED for failure in shown if failure.node is not None}
    if last is not None and last.node is not None:
        nodes[last.node] = palette.TARGET
    labels = []
    for place in group_by_place(shown):
        node = next((each.node for each in place if each.node is not None), None)
        pose = None if node is None else context.pose(node)
        if pose is not None:
            labels.append(Label((float(pose[0]), float(pose[1])), f"{len(place)} failed"))
    return Overlay(tuple(strokes), nodes, labels=tuple(labels))


def add_lifelong_curves(context: DebugContext, strip: LifelongSuccess, builder: AnswerBuilder) -> None:
    """Add the curves and the dips to a page; nothing for a single query."""
    if len(strip.queries) < 2:
        return
    now = Strong(f"{100 * strip.success[-1]:.0f} %")
    builder.add_line("Success over the last queries, now ", now, ":")
    builder.add_chart(_chart(strip.success, "share that arrived", palette.SOURCE))
    sizes = (("nodes", strip.nodes, palette.NODE), ("edges", strip.edges, palette.PLAN))
    for name, counts, colour in (each for each in sizes if np.ptp(each[1]) > 0):
        builder.add_chart(_chart(counts, name, colour))
    for dip in sorted(strip.dips, key=lambda dip: -dip.fall)[:_DIPS]:
        _dip(context, strip, dip, builder)


def _chart(values: Sequence[float] | np.ndarray, label: str, colour: Rgb8) -> StepChart:
    """Draw one value after each query (Q,)."""
    rows = np.unique(np.linspace(0, len(values) - 1, min(len(values), _POINTS)).astype(np.intp))
    points = tuple((float(row + 1), float(values[row])) for row in rows)
    x = Axis("queries", 1.0, float(len(values)), is_count=True)
    y = Axis(label, 0.0, max(1.0, float(np.max(values))))
    return StepChart(points, x, y, colour)


def _dip(context: DebugContext, strip: LifelongSuccess, dip: SuccessDip, builder: AnswerBuilder) -> None:
    """Report a drop of success, and the map changes at that time."""
    first = strip.queries[dip.peak]
    last = strip.queries[dip.low]
    begin = time_link(context.seconds(dip.before), f"query {first}")
    end = time_link(context.seconds(dip.after), f"query {last}")
    within = slice(dip.peak + 1, dip.low + 1)
    counts = [int(column[within].sum()) for column in (strip.pruned, strip.edges_added, strip.nodes_added)]
    builder.add_line(
        *(Strong("Dip:"), f" success fell by {100 * dip.fall:.0f} % from ", begin, " to ", end),
        f"; meanwhile {counts[0]} edges were removed, {counts[1]} edges and {counts[2]} nodes were added.",
    )
    touched = _touched(context, dip)
    if touched:
        named: list[Inline] = [part for edge, what in touched for part in (", ", edge_link(*edge), f" {what}")]
        builder.add_line("Edges that it changed most: ", named[1:], ".")


def _touched(context: DebugContext, dip: SuccessDip) -> list[tuple[EdgeKey, str]]:
    """Return the edges that changed most often during a dip, each with its last change; pruned edges come first."""
    timeline = context.timeline
    counts = Counter[EdgeKey]()
    ends = dict[EdgeKey, str]()
    first, last = (timeline.change_count_before(timeline.count_until(each)) for each in (dip.before, dip.after))
    for change in timeline.changes[first:last]:
        delta = change.delta
        match delta:
            case EdgePruned():
                edge = (delta.source, delta.target)
                what = "pruned"
            case BeliefUpdated():
                edge = (delta.source, delta.target)
                what = f"then p {delta.belief.p:.2f}"
            case EdgeAdded():
                edge = (delta.edge.source, delta.edge.target)
                what = "new"
            case _:
                continue
        counts[edge] += 1
        ends[edge] = what
    ranked = sorted(counts, key=lambda edge: (ends[edge] != "pruned", -counts[edge]))
    return [(edge, ends[edge]) for edge in ranked[:_EDGES]]


def _add_map_faults(context: DebugContext, failure: FailedQuery, builder: AnswerBuilder) -> None:
    """Report suspicious parts of the map at the beginning of the query; nothing if there are none."""
    graph = context.timeline.graph_before(failure.query.first)
    question = "map faults", context.name, context.start_s, failure.query.first, failure.query.last
    start = failure.node if failure.query.outcome is Outcome.NO_PATH else None

    def search() -> list[MapFinding]:
        """Search for the faults; runs in the worker's thread."""
        gap = None if start is None else map_gap(graph, start, failure.query.goal)
        return [*contradicted_edges(graph)[:_MAP_ROWS], *([] if gap is None else [gap])]

    faults: list[MapFinding] | None = context.in_background(question, search)
    if faults is None:
        builder.add_pending("Searching the map")
        return
    for fault in faults:
        builder.add_map_finding(fault)
