"""The edge microscope: images, prediction, belief and attempts of an edge, then the reasons for them, and its presence.

Owns the order of the parts, and the first of them; the others are `edge_reasons` and `edge_presence`.
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
)
from ltvn_core.analysis.edge_history import EdgeAttempt, EdgeHistory, EdgeRemoval, TimedBelief, edge_history
from ltvn_core.analysis.plan_explanation import CAUSE_TEXTS
from ltvn_core.errors import OptionError
from ltvn_core.geometry import compose
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.terminal_text import count_text
from ltvn_core.types import Waypoint
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.debugger.edge_presence import EdgeDecisionsPart, EdgePresencePart, add_all_edges
from ltvn_viz.debugger.edge_reasons import add_edge_reasons, add_node_reasons
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


def add_later_changes(context: DebugContext, story: EdgeHistory, builder: AnswerBuilder) -> None:
    """Report when an edge is removed from the map or added after the moment; nothing if neither happens."""
    later = edge_history(context.timeline, story.source, story.target)
    if story.alive and later.lifetimes and (end := later.lifetimes[len(story.lifetimes) - 1].end) is not None:
        builder.add_line("Later it is removed, at ", time_link(context.seconds(end.instant)), ".")
    elif not story.alive and len(later.lifetimes) > len(story.lifetimes):
        added_at = later.lifetimes[len(story.lifetimes)].added_at
        again = "back " if story.lifetimes else ""
        builder.add_line(f"Later it is added {again}at ", time_link(context.seconds(added_at)), ".")


_ATTEMPTS = 40


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
            builder.add_line(f"Node {node}. Choose one of its edges:")
            graph, rows = context.graph, []
            for target in sorted(graph.successors(node)) if node in graph.nodes else ():
                edge = graph.edges[node, target]
                rows.append((edge_link(node, target), f"{edge.belief.p:.2f}", edge.action or f"{edge.belief.mu:.2f}"))
            builder.add_table(("edge", "p", "length (mu), or action"), rows)
            add_node_reasons(context, node, selection.before, builder)
        strokes = add_all_edges(context, builder) + self._decisions.add(context, None, builder)
        return Overlay(strokes, {} if node is None else {node: palette.SOURCE})

    def _edge(self, context: DebugContext, edge: EdgeKey, builder: AnswerBuilder) -> Overlay:
        source, target = edge
        story = edge_history(context.timeline, source, target, context.instant)
        builder.add_line("Edge ", Strong(f"{source} → {target}"), " · ", Link("the way back", PointAt(target, source)))
        if story.lifetimes:
            _add_prediction(context, story, builder)
            _add_beliefs(context, story, builder)
        add_later_changes(context, story, builder)
        if story.attempts and story.lifetimes:
            builder.add_line(Strong("Attempts"))
            rows = [_attempt(context, each) for each in story.attempts[-_ATTEMPTS:]]
            builder.add_table(("when", "from", "result", "d", "r"), rows)
        elif story.lifetimes:
            before = story.lifetimes[-1].beliefs[0].attempts
            earlier = f"; {count_text(before, 'attempt')} were loaded with the map" if before else ""
            builder.add_line(Strong("Attempts"), f" It was not driven in this run up to now{earlier}.")
        add_edge_reasons(context, story, builder)
        self._presence.add_edge(context, story, builder)
        return _overlay(context, story, self._decisions.add(context, edge, builder))


def _add_prediction(context: DebugContext, story: EdgeHistory, builder: AnswerBuilder) -> None:
    life = story.lifetimes[-1]
    action = _action(context, story)
    waypoint = None if action else np.array(life.waypoint)
    builder.add_pictures(
        Picture(context.observation(story.source), f"from {story.source}", context.camera, waypoint),
        Picture(context.observation(story.target), f"to {story.target}", context.camera),
    )
    if waypoint is None:
        cost_m = life.beliefs[-1].belief.mu
        builder.add_line(
            "The robot does not drive it. It waits for the action ",
            Strong(action),
            f", which counts as {cost_m:.1f} m of driving in a plan.",
        )
        return
    foretold = _number(life.initial_reachability)
    builder.add_line(f"Predicted: {_where(waypoint)}; ", Term("r"), f"\u00a0{foretold}.")


def _action(context: DebugContext, story: EdgeHistory) -> str:
    """Return the action that the edge needs now; empty if it is driven, or not in the map."""
    edge = context.graph.edges.get((story.source, story.target))
    return "" if edge is None else edge.action


def _add_beliefs(context: DebugContext, story: EdgeHistory, builder: AnswerBuilder) -> None:
    beliefs = [each for life in story.lifetimes for each in life.beliefs]
    now = beliefs[-1].belief
    length = (Term("length (mu)"), " ", Strong(f"{now.mu:.2f}"), f" ± {now.sigma2**0.5:.2f} · ")
    added_at = story.lifetimes[-1].added_at
    builder.add_line(
        *(Term("p"), " ", Strong(f"{now.p:.2f}"), " · "),
        *(() if _action(context, story) else length),
        *("in the map since " if story.alive else "came at ", time_link(context.seconds(added_at)), " · "),
        f"in {count_text(len(story.planned_at), 'plan')}",
    )
    builder.add_chart(_belief_chart(context, beliefs))
    if (end := story.lifetimes[-1].end) is not None:
        builder.add_line("It was removed at ", time_link(context.seconds(end.instant)), f" {_departed(end)}.")


def _belief_chart(context: DebugContext, beliefs: Sequence[TimedBelief]) -> StepChart:
    points = tuple((context.seconds(each.instant), each.belief.p) for each in beliefs)
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


def _departed(end: EdgeRemoval) -> str:
    """Return the reason why an edge was removed from the map."""
    if end.whole_map:
        return f"because another map replaced this one, {CAUSE_TEXTS[end.cause]}"
    if end.node is not None:
        return f"together with node {end.node}, {CAUSE_TEXTS[end.cause]}"
    if end.attempt is not None:
        return f"because attempt {end.attempt} failed"
    return CAUSE_TEXTS[end.cause]


def _overlay(context: DebugContext, story: EdgeHistory, decided: tuple[Stroke, ...]) -> Overlay:
    ends = {story.source: palette.SOURCE, story.target: palette.TARGET}
    start = context.pose(story.source)
    end = context.pose(story.target)
    if start is None or end is None:
        return Overlay(decided, ends)
    is_driven = story.lifetimes and not _action(context, story)
    ghost = tuple(compose(start, np.array(story.lifetimes[-1].waypoint)).tolist()) if is_driven else None
    return Overlay(
        strokes=decided or (stroke(start, end, palette.TARGET),),
        nodes=ends,
        ghosts=() if ghost is None else (ghost,),
    )


def _attempt(context: DebugContext, row: EdgeAttempt) -> tuple[Inline, ...]:
    localised, ended = row.record.localised, row.ended
    at = "–" if localised is None or localised.node is None else str(localised.node)
    begin = time_link(context.seconds(row.begin))
    if ended is None:
        return begin, at, Hint("under way", "it has not ended"), "–", "–"
    result = Hint("success" if ended.succeeded else ended.end.failure, ended.reason)
    return begin, at, result, _number(ended.distance), _number(ended.reachability)


def _where(waypoint: Waypoint) -> str:
    dx = float(waypoint[0])
    dy = float(waypoint[1])
    turn = float(np.degrees(waypoint[2]))
    along = f"{abs(dx):.2f} m {'ahead' if dx >= 0 else 'back'}, {abs(dy):.2f} m to the {'left' if dy >= 0 else 'right'}"
    return f"{along}, turned {abs(turn):.0f}° {'left' if turn >= 0 else 'right'}"


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}"
