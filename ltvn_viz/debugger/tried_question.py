"""Why the robot set off for an edge that was seen blocked, or went around it: what was expected of each way."""

import itertools
from collections.abc import Sequence
from functools import partial
from typing import Never

from ltvn_core import palette
from ltvn_core.analysis.presence_decision import PresenceDecision, explain_decision, presence_decision
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import PlanRecord
from ltvn_core.config import Method
from ltvn_core.graph.planner import EdgeWeight, GraphPath
from ltvn_core.graph.presence.presence_filter import PresenceFilter
from ltvn_core.palette import Rgb8
from ltvn_viz.debugger.background_cache import LatestAnswer
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.debugger.edge_weighting import edge_weighting
from ltvn_viz.debugger.question import AnswerBuilder, Question
from ltvn_viz.debugger.svg_figures import legend_item
from ltvn_viz.session.commands import PointAt
from ltvn_viz.session.inspection import QuestionAnswer, QuestionName, Selection
from ltvn_viz.session.overlay import Overlay, Stroke, stroke

_PLANS = 40
"""So many plans before the moment are looked through."""
_ROWS = 8


class TriedQuestion(Question[Never]):
    """Explains plans by what is open."""

    name = QuestionName.TRIED
    word = QuestionName.TRIED.word
    is_for_watchers = True
    about = "Plans with an edge on the shortest way that was seen blocked: what was expected of it and of going round."

    def __init__(self) -> None:
        """Begin with nothing computed."""
        self._latest = LatestAnswer()
        self._run: object = None

    def is_offered(self, context: DebugContext) -> bool:
        """Tell whether any edge was ever seen blocked in the run."""
        return context.was_seen_blocked

    def answer(self, context: DebugContext, selection: Selection) -> QuestionAnswer:
        """Explain the last such plan up to the moment, and offer those before."""
        builder = AnswerBuilder()
        if context.presence_filter is None:
            builder.add_text("Plans of this run take no account of what is open now: every edge that exists is driven.")
            return builder.build()
        found = self._decisions(context)
        if found is None:
            builder.add_pending("Planning once more")
            return builder.build()
        builder.add_behind(self._latest)
        chosen = [each for each in found if selection.edge in (None, each.edge)] or found
        if not chosen:
            builder.add_text("Up to now no edge that was last seen blocked lay on the shortest way of a plan.")
            return builder.build()
        made = chosen[-1]
        _explain(context, made, builder)
        _others(context, [each for each in found if each is not made], builder)
        return builder.build(_overlay(context, made))

    def _decisions(self, context: DebugContext) -> Sequence[PresenceDecision] | None:
        count = context.timeline.count_until(context.instant)
        plans = [plan for plan in context.timeline.plans if plan.event < count][-_PLANS:]
        last = plans[-1].event if plans else -1
        run = context.name, context.start_s
        if run != self._run:
            self._run = run
            self._latest.forget()
        assert context.presence_filter is not None
        weight = edge_weighting(context).edge_weight_of(context.method)
        explain = partial(_decided, context.timeline.copy(), plans, context.method, context.presence_filter, weight)
        return self._latest(context.in_background, ("tried", *run, last), explain)


def _decided(
    timeline: Timeline,
    plans: Sequence[PlanRecord],
    method: Method,
    presence_filter: PresenceFilter,
    weight: EdgeWeight,
) -> list[PresenceDecision]:
    """Run in the worker's thread."""
    made = (presence_decision(timeline, plan, method.planning, presence_filter, weight=weight) for plan in plans)
    return [each for each in made if each is not None]


def _explain(context: DebugContext, made: PresenceDecision, builder: AnswerBuilder) -> None:
    edge = builder.link(f"{made.edge[0]} → {made.edge[1]}", PointAt(*made.edge))
    title = "Why did it try the door?" if made.tried else "Why did it go around?"
    when = builder.time_link(context.seconds(made.plan.instant))
    builder.add_html(f"<div><b>{title}</b> Query {made.plan.planned.query}, {when}, edge {edge}.</div>")
    for sentence in explain_decision(made):
        builder.add_text(sentence.replace("->", "→").replace(" x ", " × "))
    builder.add_html(
        f"<div>{legend_item(palette.TARGET, 'through')}{legend_item(palette.PLAN, 'around')}"
        f"{legend_item(palette.EDGE_REMOVED, 'seen blocked')}</div>"
    )


def _others(context: DebugContext, others: Sequence[PresenceDecision], builder: AnswerBuilder) -> None:
    if not others:
        return
    rows = [
        (
            builder.time_link(context.seconds(each.plan.instant)),
            builder.link(f"{each.edge[0]} → {each.edge[1]}", PointAt(*each.edge)),
            f"{each.p:.2f}",
            "tried" if each.tried else "around",
        )
        for each in reversed(others[-_ROWS:])
    ]
    builder.add_table(("before", "edge", "p open", "it"), rows)


def _overlay(context: DebugContext, made: PresenceDecision) -> Overlay:
    strokes = (
        *_strokes(context, made.around, palette.PLAN),
        *_strokes(context, made.through, palette.TARGET),
        *_strokes(context, GraphPath(made.edge, 0.0), palette.EDGE_REMOVED),
    )
    return Overlay(strokes, {made.edge[0]: palette.SOURCE, made.edge[1]: palette.TARGET})


def _strokes(context: DebugContext, path: GraphPath, colour: Rgb8) -> tuple[Stroke, ...]:
    poses = [context.pose(node) for node in path.nodes]
    ends = itertools.pairwise(poses)
    return tuple(stroke(start, end, colour) for start, end in ends if start is not None and end is not None)
