"""The first answer: how the query at the moment went, in three sentences, one image, and the next two questions.

Owns its words. The cause of a failure comes from `ltvn_core.analysis.failure_triage`, what a map lacks from
`ltvn_core.analysis.map_findings`.
"""

from collections.abc import Mapping
from functools import partial
from typing import Never

import numpy as np

from ltvn_core.analysis.answer import Link, Picture, Strong
from ltvn_core.analysis.failure_triage import FailedQuery, FailureMode, failed_query
from ltvn_core.analysis.map_findings import map_findings
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import AttemptRecord, Instant, QueryRecord
from ltvn_core.analysis.what_if_changes import WithoutEdge
from ltvn_core.graph.deltas import Edge
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.terminal_text import count_text
from ltvn_core.types import FrameId, NodeId, Observation, Waypoint
from ltvn_viz.debugger.background_cache import LatestAnswer
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.debugger.question import AnswerBuilder, Question, time_link
from ltvn_viz.debugger.what_if_question import ImagineChange
from ltvn_viz.session.inspection import QuestionAnswer, QuestionName, Selection
from ltvn_viz.wishes.commands import AskAbout

_CAUSES: Mapping[FailureMode, str] = {
    FailureMode.ODOMETRY: "by odometry it got to the end of an edge, but the image there shows another place",
    FailureMode.FALSE_EDGE: "an edge led elsewhere, though nothing was in the way",
    FailureMode.OBSTRUCTED: "something was in the way",
    FailureMode.NOT_RECOGNISED: "the images showed neither where the robot was nor a way to the goal",
}
_WHERE = Link("Where am I?", AskAbout(QuestionName.WHERE))
_DECISIONS = Link("Why this way?", AskAbout(QuestionName.DECISIONS))
_FAILURES = Link("What failed?", AskAbout(QuestionName.FAILURES))


class FirstQuestion(Question[Never]):
    """Says what went wrong, or what the robot does, or what a map lacks."""

    name = QuestionName.FIRST
    about = "How the query at this moment went, and what to ask next."

    def __init__(self) -> None:
        """Start without advice about a map."""
        self._advice = LatestAnswer()

    def answer(self, context: DebugContext, selection: Selection) -> QuestionAnswer:
        """Tell about the selected query, the latest one, or the map before the first query."""
        builder = AnswerBuilder()
        query = context.latest_query if selection.query is None else context.query(selection.query)
        if query is None:
            self._before_any(context, builder)
        elif query.end is None or query.end.step > context.step:
            _under_way(context, query, builder)
        elif query.succeeded is False:
            _failed(context, query, builder)
        else:
            _ended(context, query, builder)
        return builder.build()

    def _before_any(self, context: DebugContext, builder: AnswerBuilder) -> None:
        """Tell what the map has and lacks, and what can be asked."""
        graph = context.moment.graph
        has = f"the map has {count_text(len(graph.ids), 'node')} and {count_text(len(graph.edges), 'edge')}"
        builder.add_line(Strong("No query"), f" has begun yet; {has if len(graph.ids) else 'there is no map'}.")
        later = sorted(context.timeline.queries, key=lambda each: each.succeeded is not False)
        if later:
            does = "fails" if later[0].succeeded is False else "begins"
            builder.add_line(f"Later query {later[0].id} to node {later[0].goal} {does}.")
            builder.add_next(_at_its_end(context, later[0]), _FAILURES)
        elif context.is_live:
            edge = tuple(graph.ids[graph.edges[np.argmin(graph.p)]].tolist()) if len(graph.p) else None
            if edge is not None:
                builder.add_line(f"It believes least in edge {edge[0]} → {edge[1]}, p {graph.p.min():.2f}.")
            drive = Link("Where to drive next?", AskAbout(QuestionName.COACH))
            builder.add_next(drive, _WHERE if edge is None else _about_edge(edge))
        elif len(graph.edges):
            self._weak(context, builder)
        else:
            compare = Link("What is different?", AskAbout(QuestionName.COMPARE))
            builder.add_next(compare, Link("Show it to somebody", AskAbout(QuestionName.SHARE)))

    def _weak(self, context: DebugContext, builder: AnswerBuilder) -> None:
        run = context.name, context.start_s
        self._advice.about(run)
        changes = context.timeline.change_count_before(context.timeline.count_until(context.instant))
        look = partial(_weakness, context.timeline.copy(), context.instant)
        found: tuple[str, Edge] | None = self._advice(context.in_background, ("weak map", *run, changes), look)
        if found is None:
            builder.add_pending("Looking at the map")
            return
        lacks, edge = found
        ends = edge.source, edge.target
        builder.add_line(lacks)
        builder.add_line(f"It believes least in edge {ends[0]} → {ends[1]}, p {edge.belief.p:.2f}.")
        seen = context.observation(edge.source)
        builder.add_next(_about_edge(ends), _without(ends))
        if seen is not None:
            builder.add_pictures(_view(context, seen, ends[1], np.array(edge.waypoint)))


def _weakness(timeline: Timeline, instant: Instant) -> tuple[str, Edge]:
    """Return what a map lacks in one sentence, and the edge with the lowest p; runs in the worker's thread."""
    graph = timeline.graph_at(instant)
    nodes = sorted(graph.nodes)
    found = map_findings(graph, nodes, np.array([graph.nodes[node].odometry for node in nodes]))
    return found[0].finding.text, min(graph.edges.values(), key=lambda edge: edge.belief.p)


def _failed(context: DebugContext, query: QueryRecord, builder: AnswerBuilder) -> None:
    key = "failed query", context.name, context.start_s, query.first, query.ended, query.judged
    failure: FailedQuery | None = context.in_background(key, partial(failed_query, context.timeline.copy(), query))
    if failure is None:
        builder.add_pending("Searching the query")
        return
    attempt = next((each for each in reversed(query.attempts) if each.event <= failure.event), None)
    edge = failure.edge or _edge(attempt)
    cause = f" to node {query.goal} failed ({failure.ending}): {_CAUSES[failure.failure_mode]}."
    builder.add_line(Strong(f"Query {query.id}"), cause)
    wrong = context.timeline.instant(failure.event)
    builder.add_line(time_link(context.seconds(wrong)), f" {failure.text}")
    if failure.edge is None and edge is not None:
        builder.add_line(f"The last edge that it drove is {edge[0]} → {edge[1]}.")
    elif edge is None and failure.node is not None:
        builder.add_line(f"It was last localised at node {failure.node}.")
    before_s = context.seconds(failure.instant)
    where = Link("Where was it then?", AskAbout(QuestionName.WHERE, at_s=before_s))
    if edge is None:
        builder.add_next(where, _FAILURES)
    else:
        is_alias = failure.failure_mode is FailureMode.ODOMETRY
        builder.add_next(_about_edge(edge), where if is_alias else _without(edge, before_s))
    first = next((each for each in query.attempts if edge is not None and _edge(each) == edge), attempt)
    _add_view(context, first, wrong, builder)


def _under_way(context: DebugContext, query: QueryRecord, builder: AnswerBuilder) -> None:
    begun = [each for each in query.attempts if each.begin.step <= context.step]
    ended = [each.ended for each in begun if each.ended and each.end is not None and each.end.step <= context.step]
    failed = [each for each in ended if not each.succeeded]
    attempt = begun[-1] if len(begun) > len(ended) else None
    edge = _edge(attempt)
    does = "looks where it is, and plans" if attempt is None else f"drives to node {attempt.started.target}"
    does = does if edge is None else f"drives edge {edge[0]} → {edge[1]}"
    builder.add_line(Strong(f"Query {query.id}"), f" to node {query.goal} is under way: the robot {does}.")
    if failed:
        count = f"{len(failed)} of {count_text(len(ended), 'attempt')} failed"
        builder.add_line(f"{count}, the last one because {failed[-1].reason or failed[-1].end}.")
    if query.succeeded is False:
        builder.add_line("Later it fails.")
    first = _WHERE if edge is None else _about_edge(edge)
    builder.add_next(first, _at_its_end(context, query) if query.succeeded is False else _DECISIONS)
    _add_view(context, attempt, context.instant, builder)


def _ended(context: DebugContext, query: QueryRecord, builder: AnswerBuilder) -> None:
    assert query.end is not None
    failed = sum(each.failed for each in query.attempts)
    bad = sum(each.succeeded is False and each.last < query.first for each in context.timeline.queries)
    end = time_link(context.seconds(query.end))
    told = "nothing went wrong" if query.succeeded else "it was ended by hand"
    builder.add_line(Strong(f"Query {query.id}"), f" to node {query.goal} {query.outcome} at ", end, f": {told}.")
    if failed:
        builder.add_line(f"{failed} of {count_text(len(query.attempts), 'attempt')} failed on the way.")
    if bad:
        builder.add_line(f"{count_text(bad, 'earlier query', 'earlier queries')} failed.")
    what = Link("What happened when?", AskAbout(QuestionName.TIME))
    builder.add_next(_DECISIONS, _FAILURES if bad else what)
    _add_view(context, query.attempts[-1] if query.attempts else None, query.end, builder)


def _add_view(context: DebugContext, attempt: AttemptRecord | None, at: Instant, builder: AnswerBuilder) -> None:
    """Add the image at the begin of an attempt with its waypoint, or the newest image at a moment."""
    frames = context.timeline.frames
    frame: FrameId = frames.step(max(frames.count_at(at.stamp) - 1, 0)) if attempt is None else attempt.started.frame
    seen = context.observation(frame)
    if seen is None:
        pass
    elif attempt is None:
        builder.add_pictures(Picture(seen, "what the robot saw then", context.camera))
    else:
        builder.add_pictures(_view(context, seen, attempt.started.target, np.array(attempt.started.waypoint)))


def _view(context: DebugContext, seen: Observation, target: NodeId, waypoint: Waypoint) -> Picture:
    picture = Picture(seen, "", context.camera, waypoint)
    where = "out of it is where" if picture.pole is None else "the pole stands where"
    return picture._replace(caption=f"what the robot saw; {where} it expected node {target}")


def _edge(attempt: AttemptRecord | None) -> EdgeKey | None:
    started = None if attempt is None else attempt.started
    return None if started is None or started.source is None else (started.source, started.target)


def _about_edge(edge: EdgeKey) -> Link:
    return Link("Why this edge?", AskAbout(QuestionName.EDGE, edge))


def _without(edge: EdgeKey, at_s: float | None = None) -> Link:
    imagine = AskAbout(QuestionName.WHAT_IF, edge, ImagineChange(WithoutEdge(*edge)), at_s)
    return Link("What if it were not there?", imagine)


def _at_its_end(context: DebugContext, query: QueryRecord) -> Link:
    end_s = None if query.end is None else context.seconds(query.end)
    label = "What will go wrong?" if query.succeeded is False else "How will it end?"
    return Link(label, AskAbout(QuestionName.FIRST, at_s=end_s))
