"""The edge microscope: images, prediction, belief and attempts of an edge, then the reasons for them, and its presence.

Owns the order of the parts. `ltvn_core.analysis.edge_story` finds what happened to the edge, `edge_explanation` writes
the reasons, and `edge_presence` shows when it is open.
"""

import re
from collections.abc import Sequence
from typing import Never

import numpy as np

from ltvn_core import palette
from ltvn_core.analysis.answer import (
    PROBABILITY,
    Axis,
    Hint,
    Inline,
    Link,
    Picture,
    Step,
    StepChart,
    Strong,
    Term,
    joined,
)
from ltvn_core.analysis.edge_explanation import explain_edge, explain_node, p_change_text
from ltvn_core.analysis.edge_story import EdgeStory, edge_story
from ltvn_core.analysis.plan_explanation import Reason, explain_planned_edge
from ltvn_core.analysis.timeline_records import AttemptRecord, MarkKind
from ltvn_core.errors import OptionError
from ltvn_core.geometry import compose, distance
from ltvn_core.graph.deltas import Edge
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.terminal_text import count_text
from ltvn_core.types import NodeId, Waypoint
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.debugger.edge_presence import EdgeDecisionsPart, EdgePresencePart, add_all_edges
from ltvn_viz.debugger.question import AnswerBuilder, Question, edge_link, has_map, time_link
from ltvn_viz.session.inspection import (
    NOTHING_SELECTED,
    Overlay,
    QuestionAnswer,
    QuestionName,
    Selection,
    Stroke,
    stroke,
)
from ltvn_viz.wishes.commands import PointAt

_ATTEMPTS = 40
_GONE = 12
_HOW_TO_POINT = Step(
    "Click an edge, or a node and then its neighbour; or type two numbers to ask about an edge.",
    "Ask about an edge by --edge FROM TO, or about a node by --node NODE.",
)


class EdgeQuestion(Question[Never]):
    """Shows one edge, or the edges of a node."""

    name = QuestionName.EDGE
    is_offered = has_map
    about = "Images, belief and attempts of an edge or a node, the reasons for its belief, and when it is open."

    def __init__(self) -> None:
        """Start without input."""
        self._typed: EdgeKey | None = None
        self._under = NOTHING_SELECTED
        self._presence = EdgePresencePart()
        self._decisions = EdgeDecisionsPart()

    def answer(self, context: DebugContext, selection: Selection) -> QuestionAnswer:
        """Show the typed or selected edge; else the selected node, and all edges that were seen blocked."""
        if selection != self._under:
            self._under = selection
            self._typed = None
        builder = AnswerBuilder()
        edge = self._typed or selection.edge
        overlay = self._no_edge(context, selection, builder) if edge is None else self._edge(context, edge, builder)
        return builder.build(overlay, "From node, to node")

    def handle_text(self, context: DebugContext, text: str) -> None:
        """Select the edge between two typed nodes."""
        numbers = [int(number) for number in re.findall(r"\d+", text)]
        if len(numbers) != 2 or numbers[0] == numbers[1]:
            raise OptionError("Type the numbers of two different nodes, from and to, for instance: 12 40.")
        self._typed = numbers[0], numbers[1]

    def _no_edge(self, context: DebugContext, selection: Selection, builder: AnswerBuilder) -> Overlay:
        node = selection.node
        if node is None:
            builder.add_line(_HOW_TO_POINT)
        else:
            graph, rows = context.graph, []
            for target in sorted(graph.successors(node)) if node in graph.nodes else ():
                edge = graph.edges[node, target]
                rows.append((edge_link(node, target), f"{edge.belief.p:.2f}", edge.action or f"{edge.belief.mu:.2f}"))
            builder.add_line(f"Node {node}. Choose one of its edges:" if rows else f"No edge leads from node {node}.")
            builder.add_table(("edge", "p", "length (mu), or action"), rows)
            _add_node_reasons(context, node, selection.before, builder)
        strokes = add_all_edges(context, builder) + self._decisions.add(context, None, builder)
        return Overlay(strokes, {} if node is None else {node: palette.SOURCE})

    def _edge(self, context: DebugContext, edge: EdgeKey, builder: AnswerBuilder) -> Overlay:
        source, target = edge
        story = edge_story(context.timeline, source, target, context.instant)
        builder.add_line("Edge ", Strong(f"{source} → {target}"), " · ", Link("the way back", PointAt(target, source)))
        if story.last is not None:
            _add_prediction(context, story, story.last, builder)
            _add_beliefs(context, story, story.last, builder)
        _add_later_change(context, story, builder)
        if story.last is not None:
            _add_attempts(context, story, story.last, builder)
        _add_edge_reasons(context, story, builder)
        self._presence.add_edge(context, story, builder)
        return _overlay(context, story, self._decisions.add(context, story, builder))


def _add_prediction(context: DebugContext, story: EdgeStory, edge: Edge, builder: AnswerBuilder) -> None:
    action = _action(context, story)
    waypoint = None if action else np.array(edge.waypoint)
    builder.add_pictures(
        Picture(context.observation(story.source), f"from {story.source}", context.camera, waypoint),
        Picture(context.observation(story.target), f"to {story.target}", context.camera),
    )
    if waypoint is None:
        builder.add_line(
            "The robot does not drive it. It waits for the action ",
            Strong(action),
            f", which counts as {edge.belief.mu:.1f} m of driving in a plan.",
        )
        return
    first = story.life[0].after
    # p of an edge that was not driven before it was added is r of the prediction.
    foretold = None if first is None or first.attempts else first.belief.p
    builder.add_line(f"Predicted: {_where(waypoint)}; ", Term("r"), f"\u00a0{_number(foretold)}.")


def _action(context: DebugContext, story: EdgeStory) -> str:
    """Return the action that the edge needs now; empty if it is driven, or not in the map."""
    edge = context.graph.edges.get(story.edge)
    return "" if edge is None else edge.action


def _add_beliefs(context: DebugContext, story: EdgeStory, edge: Edge, builder: AnswerBuilder) -> None:
    now = edge.belief
    length = (Term("length (mu)"), " ", Strong(f"{now.mu:.2f}"), f" ± {now.sigma2**0.5:.2f} · ")
    builder.add_line(
        *(Term("p"), " ", Strong(f"{now.p:.2f}"), " · "),
        *(() if _action(context, story) else length),
        "in the map since " if story.alive else "came at ",
        time_link(context.seconds(story.life[0].instant)),
        f" · in {count_text(len(story.planned_at), 'plan')}",
    )
    builder.add_chart(_belief_chart(context, story))
    if story.end is not None:
        builder.add_line("It was removed at ", time_link(context.seconds(story.end.instant)), ".")


def _add_later_change(context: DebugContext, story: EdgeStory, builder: AnswerBuilder) -> None:
    """Report when an edge is removed from the map or added after the moment; nothing if neither happens."""
    later = edge_story(context.timeline, story.source, story.target).rows[len(story.rows) :]
    change = next((row for row in later if row.is_addition or row.is_removal), None)
    if change is not None:
        does = "is removed," if change.is_removal else "is added back" if story.life else "is added"
        builder.add_line(f"Later it {does} at ", time_link(context.seconds(change.instant)), ".")


def _add_attempts(context: DebugContext, story: EdgeStory, edge: Edge, builder: AnswerBuilder) -> None:
    if story.attempts:
        builder.add_line(Strong("Attempts"))
        rows = [_attempt(context, story, each) for each in story.attempts[-_ATTEMPTS:]]
        builder.add_table(("when", "from", "result", "d", "r", "p"), rows)
        return
    earlier = f"; {count_text(edge.attempts, 'attempt')} were loaded with the map" if edge.attempts else ""
    builder.add_line(Strong("Attempts"), f" It was not driven in this run up to now{earlier}.")


def _belief_chart(context: DebugContext, story: EdgeStory) -> StepChart:
    points = tuple((context.seconds(instant), edge.belief.p) for instant, edge in story.beliefs)
    now_s = context.seconds(context.instant)
    last_s = max(now_s, points[0][0] + 1.0)
    return StepChart(
        points,
        Axis("time, s", min(points[0][0], last_s - 1.0), last_s),
        Axis("p", *PROBABILITY),
        colour=palette.SOURCE,
        limits=((context.method.believing.prune_below, "R_p"),),
        now=now_s,
    )


def _overlay(context: DebugContext, story: EdgeStory, decided: tuple[Stroke, ...]) -> Overlay:
    ends = {story.source: palette.SOURCE, story.target: palette.TARGET}
    start = context.pose(story.source)
    end = context.pose(story.target)
    if start is None or end is None:
        return Overlay(decided, ends)
    is_driven = story.last is not None and not _action(context, story)
    ghost = tuple(compose(start, np.array(story.last.waypoint)).tolist()) if story.last and is_driven else None
    return Overlay(
        strokes=decided or (stroke(start, end, palette.TARGET),),
        nodes=ends,
        ghosts=() if ghost is None else (ghost,),
    )


def _attempt(context: DebugContext, story: EdgeStory, attempt: AttemptRecord) -> tuple[Inline, ...]:
    localised, ended = None if attempt.plan is None else attempt.plan.localised, attempt.ended
    at = "–" if localised is None or localised.node is None else str(localised.node)
    begin = time_link(context.seconds(attempt.begin))
    if ended is None:
        return begin, at, Hint("under way", "it has not ended"), "–", "–", "–"
    result = Hint("success" if ended.succeeded else ended.end.failure, ended.reason)
    return begin, at, result, _number(ended.distance), _number(ended.reachability), _counted(story, attempt)


def _counted(story: EdgeStory, attempt: AttemptRecord) -> Inline:
    """Return how an attempt changed p; a failure after another one in its query does not."""
    query = attempt.started.query
    if (row := story.counted.get((query, attempt.started.attempt))) is not None:
        return p_change_text(row)
    counted = [each for each in story.attempts if (each.started.query, each.started.attempt) in story.counted]
    is_repeated = attempt.failed and any(each.failed and each.started.query == query for each in counted)
    return Hint("same", "of several failures in a query only the first counts") if is_repeated else "same"


def _where(waypoint: Waypoint) -> str:
    dx = float(waypoint[0])
    dy = float(waypoint[1])
    turn = float(np.degrees(waypoint[2]))
    along = f"{abs(dx):.2f} m {'ahead' if dx >= 0 else 'back'}, {abs(dy):.2f} m to the {'left' if dy >= 0 else 'right'}"
    return f"{along}, turned {abs(turn):.0f}° {'left' if turn >= 0 else 'right'}"


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}"


def _add_node_reasons(context: DebugContext, node: NodeId, before: NodeId | None, builder: AnswerBuilder) -> None:
    """Explain why a node exists, and link its missing edges; `before` was selected before it."""
    reasons = explain_node(context.timeline, node, at=context.instant)
    _chain(context, f"Why is node {node} in the map?", reasons, builder)
    if before not in (None, node):
        builder.add_line(Link(f"Why is there no edge {before} → {node}?", PointAt(before, node)))
    gone = dict.fromkeys(
        mark.ids for mark in context.timeline.marks_until(context.instant, MarkKind.PRUNE) if node in mark.ids[:2]
    )
    links = [edge_link(*ids) for ids in [*gone][-_GONE:] if len(ids) == 2]
    if links:
        builder.add_line("Edges that were pruned here: ", joined(links, ", "), ".")


def _add_edge_reasons(context: DebugContext, story: EdgeStory, builder: AnswerBuilder) -> None:
    """Explain why an edge is missing, was removed, or has its p, and why the last plan through it was made."""
    if story.last is None:
        title = "Why is it missing?"
    elif story.end is not None:
        title = "Why is it gone?"
    else:
        p = story.last.belief.p
        title = f"Why is its belief so low, p = {p:.2f}?" if p < 0.5 else f"Why is p = {p:.2f}?"
    reasons = explain_edge(
        context.timeline,
        *story.edge,
        at=context.instant,
        believing=context.method.believing,
        seen=_seen(context, story.edge) if story.last is None else None,
        thresholds=context.method.building,
    )
    _chain(context, title, reasons, builder)
    if story.planned_at:
        _chosen(context, story, builder)
    elif story.last is not None:
        builder.add_line("No plan has led through it yet.")


def _chosen(context: DebugContext, story: EdgeStory, builder: AnswerBuilder) -> None:
    timeline = context.timeline.copy()
    last = story.planned_at[-1]
    rules = context.rules
    # Replanning is slow on a large map, and the answer stays valid until the next plan.
    reasons = context.in_background(
        ("chosen", context.name, context.start_s, story.edge, last),
        lambda: explain_planned_edge(timeline, *story.edge, rules, at=last),
    )
    title = "Why was it chosen?"
    if reasons is None:
        builder.add_pending("Planning once more without it", title=title)
    else:
        _chain(context, title, reasons, builder)
        if context.rules_note:
            builder.add_line(context.rules_note)


def _chain(context: DebugContext, title: str, reasons: Sequence[Reason], builder: AnswerBuilder) -> None:
    builder.add_line(Strong(title))
    for reason in reasons:
        when: list[Inline] = [] if reason.instant is None else [time_link(context.seconds(reason.instant)), " "]
        builder.add_line(when, reason.text.replace("->", "→"))


def _seen(context: DebugContext, edge: EdgeKey) -> tuple[float, float] | None:
    """Return (r, d) of the pair by the network in use; None without images or while it is computed."""
    views = [context.observation(node) for node in edge]
    pictures = [image for seen in views if seen is not None and (image := context.as_compared(seen)) is not None]
    predictor = context.predictor
    if len(pictures) < len(views):
        return None

    def compare() -> tuple[float, float]:
        features = predictor.encode(pictures)
        said = predictor.predict(features[:1], features[1:])
        return float(said.reachability[0]), float(distance(said.waypoints)[0])

    return context.in_background(("pair", context.name, predictor.fingerprint, edge), compare)
