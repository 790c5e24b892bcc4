"""Explains plans by expected costs: why the robot drove an edge that was last seen blocked, or made a detour around
it."""

import itertools
from collections.abc import Sequence
from functools import partial

from ltvn_core import palette
from ltvn_core.analysis.answer import Key, Strong
from ltvn_core.analysis.edge_presence_history import (
    PresenceDecision,
    explain_decision,
    observed_presence,
    presence_decision,
)
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import PlanRecord
from ltvn_core.config import Method
from ltvn_core.graph.planner import EdgeWeight, GraphPath
from ltvn_core.graph.presence.presence_filter import PresenceFilter
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.palette import Rgb8
from ltvn_viz.debugger.background_cache import LatestAnswer
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.debugger.edge_weighting import edge_weighting
from ltvn_viz.debugger.question import AnswerBuilder, edge_link, time_link
from ltvn_viz.session.inspection import Stroke, stroke

_PLANS = 40
"""Number of the latest plans up to the moment that are searched."""
_ROWS = 8
_TITLE = "Why did the robot try it, or go around?"


class EdgeDecisionsPart:
    """Explains plans by p(open); caches the last result."""

    def __init__(self) -> None:
        """Start with an empty cache."""
        self._latest = LatestAnswer()
        self._run: object = None

    def add(self, context: DebugContext, edge: EdgeKey | None, builder: AnswerBuilder) -> tuple[Stroke, ...]:
        """Explain the last plan in which an edge was driven or avoided although it was last seen blocked; return the
        strokes.

        Without `edge`, explain the last such plan of any edge. Earlier such plans are listed with links. Adds nothing
        if the edge was never observed, or plans ignore presence.
        """
        if context.presence_filter is None or not _was_seen(context, edge):
            return ()
        found = self._decisions(context)
        if found is None:
            builder.add_pending("Planning once more", title=_TITLE)
            return ()
        chosen = [each for each in found if edge in (None, each.edge)]
        if not chosen:
            builder.add_behind(self._latest)
            which = "an edge" if edge is None else "it"
            builder.add_line(
                Strong(_TITLE), f" Up to now, no shortest path led through {which} that was last seen blocked."
            )
            return ()
        made = chosen[-1]
        _explain(context, made, self._latest, builder)
        _others(context, [each for each in found if each is not made], builder)
        return _strokes_of(context, made)

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
    """Return the explanations of the plans that met an edge seen blocked; runs in the worker's thread."""
    made = (presence_decision(timeline, plan, method.planning, presence_filter, weight=weight) for plan in plans)
    return [each for each in made if each is not None]


def _was_seen(context: DebugContext, edge: EdgeKey | None) -> bool:
    """Tell whether an edge was observed up to the moment; for None, whether any edge was."""
    if edge is None:
        return bool(context.graph.presence)
    return bool(observed_presence(context.timeline, *edge, context.instant))


def _explain(context: DebugContext, made: PresenceDecision, latest: LatestAnswer, builder: AnswerBuilder) -> None:
    title = "Why did the robot try it?" if made.tried else "Why did the robot go around?"
    when = time_link(context.seconds(made.plan.instant))
    query = made.plan.planned.query
    builder.add_line(Strong(title), f" Query {query}, ", when, ", edge ", edge_link(*made.edge), ".")
    builder.add_behind(latest)
    for sentence in explain_decision(made):
        builder.add_line(sentence.replace("->", "→").replace(" x ", " × "))
    builder.add_line(
        Key(palette.TARGET, "through"), Key(palette.PLAN, "around"), Key(palette.EDGE_REMOVED, "seen blocked")
    )


def _others(context: DebugContext, others: Sequence[PresenceDecision], builder: AnswerBuilder) -> None:
    if not others:
        return
    rows = [
        (
            time_link(context.seconds(each.plan.instant)),
            edge_link(*each.edge),
            f"{each.p:.2f}",
            "tried" if each.tried else "around",
        )
        for each in reversed(others[-_ROWS:])
    ]
    builder.add_table(("before", "edge", "p open", "it"), rows)


def _strokes_of(context: DebugContext, made: PresenceDecision) -> tuple[Stroke, ...]:
    return (
        *_strokes(context, made.around, palette.PLAN),
        *_strokes(context, made.through, palette.TARGET),
        *_strokes(context, GraphPath(made.edge, 0.0), palette.EDGE_REMOVED),
    )


def _strokes(context: DebugContext, path: GraphPath, colour: Rgb8) -> tuple[Stroke, ...]:
    poses = [context.pose(node) for node in path.nodes]
    ends = itertools.pairwise(poses)
    return tuple(stroke(start, end, colour) for start, end in ends if start is not None and end is not None)
