"""The slow part of imagining: planning both ways, and building both maps, in the worker's thread.

Owns which question is asked of `ltvn_core.analysis`. Shows nothing.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple, TypeAlias

import numpy as np

from ltvn_core.analysis.changes import Change, GoalSet, StartSet, Threshold, ThresholdSet
from ltvn_core.analysis.dry_run import PruneCounts, prune_dry_run, rebuild_dry_run
from ltvn_core.analysis.imagined import Weights
from ltvn_core.analysis.situation import Situation
from ltvn_core.analysis.what_if import Replanned, replan
from ltvn_core.config import Method
from ltvn_core.errors import LtvnError
from ltvn_core.graph.topograph import TopologicalGraph
from ltvn_viz.why.case import Case

_REBUILT = (Threshold.D_M, Threshold.D_C)


class Answer(NamedTuple):
    """What imagining came to."""

    plans: Replanned
    pruned: PruneCounts | None
    """Where R_p is imagined."""
    asked: Situation
    """The question that the new plan answers."""


Outcome: TypeAlias = Answer | str
"""An answer, or why there is none."""


def imagined(
    graph: TopologicalGraph, situation: Situation, method: Method, changes: tuple[Change, ...], weights: Weights
) -> Outcome:
    """Plan as it was and as it would be; costs two copies of the map and two searches."""
    if not all(isinstance(each, GoalSet | StartSet) for each in changes):
        situation = _placed(situation, changes)
    try:
        plans = replan(graph, situation, method, changes, weights=weights)
    except LtvnError as error:
        return str(error)
    levels = [each.value for each in changes if isinstance(each, ThresholdSet) and each.threshold is Threshold.R_P]
    pruned = prune_dry_run(graph, levels[-1], method.believing) if levels else None
    return Answer(plans, pruned, _placed(situation, changes))


def _placed(situation: Situation, changes: tuple[Change, ...]) -> Situation:
    """Return the situation at the imagined place, so that both plans lead from there and differ by the rest alone."""
    for each in changes:
        match each:
            case GoalSet(goal):
                situation = replace(situation, goal=goal)
            case StartSet(source):
                situation = replace(situation, source=source)
    return situation


def rebuilt_with(method: Method, changes: tuple[Change, ...]) -> Method | None:
    """Return the method with the imagined thresholds of Algorithm 1; None where none is imagined."""
    values = {each.threshold: each.value for each in changes if isinstance(each, ThresholdSet)}
    if not values.keys() & set(_REBUILT):
        return None
    building = replace(
        method.building,
        merge_distance=values.get(Threshold.D_M, method.building.merge_distance),
        connect_distance=values.get(Threshold.D_C, method.building.connect_distance),
    )
    reverse = max(method.matching.reverse_within, 1.2 * building.connect_distance)
    return replace(method, building=building, matching=replace(method.matching, reverse_within=reverse))


def dry_run(case: Case, changed: Method) -> Callable[[], str]:
    """Return what counts the live map as built with both methods; it takes tens of seconds."""
    mapping, method = case.mapping, case.method
    assert mapping is not None

    def count() -> str:
        """Run in the worker's thread, which owns the images."""
        rng = np.random.default_rng(0)
        try:
            seen = mapping.images()
            return rebuild_dry_run(seen, mapping.views, mapping.predictor, method, changed, rng).sentence
        except LtvnError as error:
            return str(error)

    return count
