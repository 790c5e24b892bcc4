"""Temporal distance: r = exp(-steps / TAU), where a step is from one image of a drive to the next.

Owns this scale, localisation by temporal distance, and the navigator's thresholds in steps. The edges and paths belong
to each system.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ltvn_core.config import Method
from ltvn_core.graph.deltas import Belief
from ltvn_core.graph.localiser import GLOBAL, Localisation, LocalisationPrior, best_localisation, doubt
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.network.training_data.temporal_rules import TAU_STEPS
from ltvn_core.types import Features

EDGE_STEPS = 8.0
"""Largest predicted temporal distance of an edge in ViNG, in steps; other systems scale their limits by it."""


def reachability_of_steps(steps: float) -> float:
    """Return r of a temporal distance in steps."""
    return math.exp(-steps / TAU_STEPS)


def temporal_distances(reachability: ArrayLike) -> NDArray[np.float64]:
    """Return the temporal distances in steps for r of any shape."""
    return TAU_STEPS * doubt(reachability)


def temporal_cost(belief: Belief) -> float:
    """Return the length of an edge in steps, at least one."""
    # Labels are at least one step; without this limit an overconfident network would make detours free.
    return max(1.0, float(temporal_distances(belief.p)))


@dataclass(frozen=True, slots=True)
class NearestInTime:
    """Localisation at the node with the least temporal distance, if it is near enough."""

    within_steps: float = math.inf

    def __call__(
        self, features: Features, graph: TopologicalGraph, prior: LocalisationPrior, matcher: Matcher
    ) -> Localisation:
        """Return that node; doubted nodes are left out."""
        matches = matcher.match(features, prior.candidates(graph))
        steps = temporal_distances(matches.reachability)
        near = (steps <= self.within_steps) & np.isfinite(matches.distances)
        return best_localisation(matches, steps, near, GLOBAL)


def with_step_thresholds(method: Method) -> Method:
    """Return the method with thresholds of the navigator that fit r of temporal distances."""
    edge = reachability_of_steps(EDGE_STEPS)
    driving = replace(
        method.driving,
        departure_reachability=edge if method.driving.departure_reachability else 0.0,
        lost_reachability=reachability_of_steps(2 * EDGE_STEPS),
    )
    judging = replace(
        method.judging, success_reachability=edge, arrive_reachability=reachability_of_steps(EDGE_STEPS / 2)
    )
    # A failure should count as much for edges of several steps as it does for edges of a metre.
    penalty = method.planning.failure_penalty * EDGE_STEPS
    return replace(
        method,
        driving=driving,
        judging=judging,
        planning=replace(method.planning, failure_penalty=penalty),
        building=replace(method.building, connect_reachability=edge),
    )
