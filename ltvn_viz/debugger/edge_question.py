"""The edge microscope: both images, the predicted waypoint, what was believed when, and every attempt."""

from html import escape
from typing import Never

import numpy as np

from ltvn_core import palette
from ltvn_core.analysis.edge_history import EdgeAttempt, EdgeHistory, edge_history
from ltvn_core.analysis.timeline_records import Instant
from ltvn_core.geometry import compose
from ltvn_core.types import Waypoint
from ltvn_viz.debugger.charts import PROBABILITY, Axis, step_chart_svg
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.debugger.later_changes import add_later_changes
from ltvn_viz.debugger.question import AnswerBuilder, Question
from ltvn_viz.debugger.svg_figures import image_figure
from ltvn_viz.server.glossary import explained
from ltvn_viz.session.commands import PointAt
from ltvn_viz.session.inspection import QuestionAnswer, QuestionName, Selection
from ltvn_viz.session.overlay import EMPTY_OVERLAY, Overlay, stroke

_ATTEMPTS = 40


class EdgeQuestion(Question[Never]):
    """Shows one edge."""

    name = QuestionName.EDGE
    word = QuestionName.EDGE.word
    is_for_watchers = True
    about = (
        "Both images of an edge, what was believed of it up to now, and each attempt. Click a node, then its neighbour."
    )

    def is_offered(self, context: DebugContext) -> bool:
        """Tell whether there ever was a map."""
        return len(context.timeline.changes) > 0

    def answer(self, context: DebugContext, selection: Selection) -> QuestionAnswer:
        """Show the edge that was pointed at, or those of the node."""
        builder = AnswerBuilder()
        if selection.edge is not None:
            return self._edge(context, edge_history(context.timeline, *selection.edge, context.instant), builder)
        if selection.node is None:
            builder.add_text("Click a node in the scene.")
            return builder.build()
        return self._edges_of(context, selection.node, builder)

    def _edges_of(self, context: DebugContext, node: int, builder: AnswerBuilder) -> QuestionAnswer:
        builder.add_text(f"Node {node}. Choose one of its edges:")
        rows = []
        for target in sorted(context.graph.successors(node)) if node in context.graph.nodes else ():
            belief = context.graph.edges[node, target].belief
            rows.append(
                (builder.link(f"{node} → {target}", PointAt(node, target)), f"{belief.p:.2f}", f"{belief.mu:.2f}")
            )
        builder.add_table(("edge", "p", "length"), rows)
        return builder.build(Overlay(nodes={node: palette.SOURCE}))

    def _edge(self, context: DebugContext, story: EdgeHistory, builder: AnswerBuilder) -> QuestionAnswer:
        source, target = story.source, story.target
        back = builder.link("the way back", PointAt(target, source))
        builder.add_html(f"<div>Edge <b>{source} → {target}</b> · {back}</div>")
        if not story.lifetimes:
            builder.add_text("The map does not have this edge and had it at no time before.")
            add_later_changes(context, story, builder)
            return builder.build(self._overlay(context, story))
        life = story.lifetimes[-1]
        waypoint = np.array(life.waypoint)
        pair = image_figure(context.observation(source), f"from {source}", context.camera, waypoint) + image_figure(
            context.observation(target), f"to {target}", context.camera
        )
        builder.add_html(f'<div class="lt-pair">{pair}</div>')
        foretold = f"{explained('r')}&nbsp;{_number(life.initial_reachability)}"
        builder.add_html(f"<div>Predicted: {_where(waypoint)}; {foretold}.</div>")
        self._beliefs(context, story, builder)
        self._attempts(context, story, builder)
        return builder.build(self._overlay(context, story))

    def _beliefs(self, context: DebugContext, story: EdgeHistory, builder: AnswerBuilder) -> None:
        beliefs = [each for life in story.lifetimes for each in life.beliefs]
        now = beliefs[-1].belief
        added_at = story.lifetimes[-1].added_at
        builder.add_html(
            f"<div>{explained('p')} <b>{now.p:.2f}</b> · "
            f"{explained('length')} <b>{now.mu:.2f}</b> ± {now.sigma2**0.5:.2f} · "
            f"{'in the map since' if story.alive else 'came at'} {self._jump(context, builder, added_at)} · "
            f"in {len(story.planned_at)} plans</div>"
        )
        points = [(context.seconds(each.instant), each.belief.p) for each in beliefs]
        now_s = context.seconds(context.instant)
        last_s = max(now_s, points[0][0] + 1.0)
        chart = step_chart_svg(
            points,
            Axis("time, s", min(points[0][0], last_s - 1.0), last_s),
            Axis("p", *PROBABILITY),
            lines=((context.method.believing.prune_below, "R_p"),),
            colour=palette.SOURCE,
            now=now_s,
        )
        builder.add_html(chart)
        if (end := story.lifetimes[-1].end) is not None:
            builder.add_html(
                f"<div>It left the map at {self._jump(context, builder, end.instant)}, {end.cause.value}.</div>"
            )
        add_later_changes(context, story, builder)

    def _attempts(self, context: DebugContext, story: EdgeHistory, builder: AnswerBuilder) -> None:
        if not story.attempts:
            builder.add_text("Nobody drove it up to now.")
            return
        rows = [self._attempt(context, each, builder) for each in story.attempts[-_ATTEMPTS:]]
        builder.add_table(("when", "from", "result", "d", "r"), rows)

    def _attempt(self, context: DebugContext, row: EdgeAttempt, builder: AnswerBuilder) -> tuple[str, ...]:
        at = "–" if row.localised is None or row.localised.node is None else str(row.localised.node)
        result = "under way" if row.succeeded is None else "success" if row.succeeded else f"failed ({row.end})"
        numbers = map(_number, (row.distance, row.reachability))
        return (
            self._jump(context, builder, row.begin),
            at,
            f'<span title="{escape(row.reason)}">{result}</span>',
            *numbers,
        )

    @staticmethod
    def _jump(context: DebugContext, builder: AnswerBuilder, instant: Instant) -> str:
        return builder.time_link(context.seconds(instant))

    @staticmethod
    def _overlay(context: DebugContext, story: EdgeHistory) -> Overlay:
        start, end = context.pose(story.source), context.pose(story.target)
        if start is None or end is None:
            return EMPTY_OVERLAY
        ghost = tuple(compose(start, np.array(story.lifetimes[-1].waypoint)).tolist()) if story.lifetimes else None
        return Overlay(
            strokes=(stroke(start, end, palette.TARGET),),
            nodes={story.source: palette.SOURCE, story.target: palette.TARGET},
            ghosts=() if ghost is None else (ghost,),
        )


def _where(waypoint: Waypoint) -> str:
    dx, dy, turn = float(waypoint[0]), float(waypoint[1]), float(np.degrees(waypoint[2]))
    along = f"{abs(dx):.2f} m {'ahead' if dx >= 0 else 'back'}, {abs(dy):.2f} m to the {'left' if dy >= 0 else 'right'}"
    return f"{along}, turned {abs(turn):.0f}° {'left' if turn >= 0 else 'right'}"


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}"
