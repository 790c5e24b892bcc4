"""The slow part of what-if questions: planning both paths in the worker's thread.

Owns the calls of `ltvn_core.analysis`, and the choice of offered times of day.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple, TypeAlias

from ltvn_core.analysis.edge_presence_history import PresenceState, presence_state
from ltvn_core.analysis.what_if_changes import WhatIfChange, WithGoal, WithStart, WithTime
from ltvn_core.analysis.what_if_scenario import EdgeWeightFactory, PlanDifference, PlannerState, PresenceMoment, replan
from ltvn_core.analysis.world_clock import DAY_S, TimeAway, TimeOfDay
from ltvn_core.config import Method
from ltvn_core.errors import LtvnError
from ltvn_core.graph.presence.presence_plan import OPEN_ABOVE
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.debugger.question import AnswerBuilder, edge_link

_ROWS = 12
OFFERED_TIMES = (WithTime(TimeOfDay(18 * 3600.0)), WithTime(TimeAway(3600.0)), WithTime(TimeAway(DAY_S)))
"""Times that are offered as links; others may be typed."""


class WhatIfResult(NamedTuple):
    """Result of a what-if question."""

    plans: PlanDifference
    asked: PlannerState
    """State of the planner for the new plan."""


WhatIfOutcome: TypeAlias = WhatIfResult | str
"""A result, or the reason why there is none."""


def plan_both_ways(
    graph: TopologicalGraph,
    situation: PlannerState,
    method: Method,
    changes: tuple[WhatIfChange, ...],
    edge_weight_of: EdgeWeightFactory,
    presence: PresenceMoment | None,
) -> WhatIfOutcome:
    """Plan with and without the changes; copies the map twice and runs two searches, eight if edges may be closed."""
    if not all(isinstance(each, WithGoal | WithStart) for each in changes):
        situation = _placed(situation, changes)
    try:
        plans = replan(graph, situation, method, changes, edge_weight_of=edge_weight_of, presence=presence)
    except LtvnError as error:
        return str(error)
    return WhatIfResult(plans, _placed(situation, changes))


def _placed(situation: PlannerState, changes: tuple[WhatIfChange, ...]) -> PlannerState:
    """Return the situation at the imagined place, so that both plans start there and differ only by other changes."""
    for each in changes:
        if isinstance(each, WithGoal):
            situation = replace(situation, goal=each.goal)
        elif isinstance(each, WithStart):
            situation = replace(situation, source=each.source)
    return situation


def presence_moment(context: DebugContext) -> PresenceMoment | None:
    """Return the moment for which plans predict presence; None if they ignore it."""
    judge = context.presence_filter
    return None if judge is None or not context.graph.presence else PresenceMoment(judge, context.world_s)


def add_open_edges(plans: PlanDifference, builder: AnswerBuilder) -> None:
    """Report the edges that would change between open and closed."""
    then = plans.new_open
    count = sum(p >= OPEN_ABOVE for p in then.values())
    before = sum(p >= OPEN_ABOVE for p in plans.old_open.values())
    builder.add_line(f"Of {len(then)} edges that were ever seen blocked {count} would count as open, now {before}.")
    changed = [edge for edge in then if _state_of(plans.old_open, edge) is not _state_of(then, edge)]
    rows = [
        (
            edge_link(*edge),
            f"{plans.old_open.get(edge, 1.0):.2f} {_state_of(plans.old_open, edge)}",
            f"{then[edge]:.2f} {_state_of(then, edge)}",
        )
        for edge in changed[:_ROWS]
    ]
    if rows:
        builder.add_table(("edge", "p open now", "p open then"), rows)
    if len(changed) > _ROWS:
        builder.add_line(f"… and {len(changed) - _ROWS} more.")


def _state_of(probabilities: Mapping[EdgeKey, float], edge: EdgeKey) -> PresenceState:
    return presence_state(probabilities.get(edge, 1.0))
