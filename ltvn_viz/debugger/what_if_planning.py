"""The slow part of imagining: planning both ways, and building both maps, in the worker's thread.

Owns which question is asked of `ltvn_core.analysis`. Shows nothing.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple, TypeAlias

import numpy as np

from ltvn_core.analysis.threshold_dry_run import PruneCounts, prune_dry_run, rebuild_dry_run
from ltvn_core.analysis.what_if_changes import WhatIfChange, WhatIfThreshold, WithGoal, WithStart, WithThreshold
from ltvn_core.analysis.what_if_scenario import EdgeWeightFactory, PlanDifference, PlannerState, PresenceMoment, replan
from ltvn_core.config import Method
from ltvn_core.errors import LtvnError
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_viz.debugger.context import DebugContext

_REBUILT = (WhatIfThreshold.D_M, WhatIfThreshold.D_C)


class WhatIfResult(NamedTuple):
    """What imagining came to."""

    plans: PlanDifference
    pruned: PruneCounts | None
    """Where R_p is imagined."""
    asked: PlannerState
    """The question that the new plan answers."""


WhatIfOutcome: TypeAlias = WhatIfResult | str
"""An answer, or why there is none."""


def plan_both_ways(
    graph: TopologicalGraph,
    situation: PlannerState,
    method: Method,
    changes: tuple[WhatIfChange, ...],
    edge_weight_of: EdgeWeightFactory,
    presence: PresenceMoment | None,
) -> WhatIfOutcome:
    """Plan as it was and as it would be; costs two copies of the map and two searches, or eight where edges may be
    closed.
    """
    if not all(isinstance(each, WithGoal | WithStart) for each in changes):
        situation = _placed(situation, changes)
    try:
        plans = replan(graph, situation, method, changes, edge_weight_of=edge_weight_of, presence=presence)
    except LtvnError as error:
        return str(error)
    levels = [
        each.value for each in changes if isinstance(each, WithThreshold) and each.threshold is WhatIfThreshold.R_P
    ]
    pruned = prune_dry_run(graph, levels[-1], method.believing) if levels else None
    return WhatIfResult(plans, pruned, _placed(situation, changes))


def _placed(situation: PlannerState, changes: tuple[WhatIfChange, ...]) -> PlannerState:
    """Return the situation at the imagined place, so that both plans lead from there and differ by the rest alone."""
    for each in changes:
        if isinstance(each, WithGoal):
            situation = replace(situation, goal=each.goal)
        elif isinstance(each, WithStart):
            situation = replace(situation, source=each.source)
    return situation


def with_imagined_thresholds(method: Method, changes: tuple[WhatIfChange, ...]) -> Method | None:
    """Return the method with the imagined thresholds of Algorithm 1; None where none is imagined."""
    values = {each.threshold: each.value for each in changes if isinstance(each, WithThreshold)}
    if not values.keys() & set(_REBUILT):
        return None
    building = replace(
        method.building,
        merge_distance=values.get(WhatIfThreshold.D_M, method.building.merge_distance),
        connect_distance=values.get(WhatIfThreshold.D_C, method.building.connect_distance),
    )
    reverse = max(method.matching.reverse_within, 1.2 * building.connect_distance)
    return replace(method, building=building, matching=replace(method.matching, reverse_within=reverse))


def count_rebuilt_nodes(context: DebugContext, changed: Method) -> Callable[[], str]:
    """Return what counts the live map as built with both methods; it takes tens of seconds."""
    live_map, method = context.live_map, context.method
    assert live_map is not None

    def count() -> str:
        """Run in the worker's thread, which owns the images."""
        rng = np.random.default_rng(0)
        try:
            seen = live_map.observations()
            return rebuild_dry_run(seen, live_map.keyframes, live_map.predictor, method, changed, rng).sentence
        except LtvnError as error:
            return str(error)

    return count
