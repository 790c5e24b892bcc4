"""BRM (Wu et al. 2019), "Bayesian Relational Memory", as far as a map of images has what it needs.

Owns its belief: an edge is a Bernoulli variable, what driving along it shows is a noisy observation of it, and the path
is the most probable one. Its nodes are kinds of rooms, named by a classifier; here they are the images of our own map,
and its numbers of observation noise are kept. So it tells what its update and its planning are worth beside ours.
"""

from dataclasses import dataclass, replace

import numpy as np

from ltvn_core.config import Method
from ltvn_core.graph.deltas import BeliefUpdated, Cause
from ltvn_core.graph.ltvn import ltvn_system
from ltvn_core.graph.maintenance import AttemptEvidence
from ltvn_core.graph.navigation_system import Deltas, NavigationSystem, NoMaintenance
from ltvn_core.graph.planner import surprise_cost
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.systems.entry import SystemEntry

ARRIVES_IF_JOINED, ARRIVES_IF_NOT = 0.95, 0.001
"""Probability of arriving along an edge that is there, and along one that is not."""
_LEAST_P = 1e-6


def brm_system(method: Method) -> NavigationSystem:
    """Return BRM on the map of our own system; `method` has all thresholds."""
    return replace(ltvn_system(method), name="brm", edge_weight=surprise_cost, maintenance=BayesianEdges(), online=None)


@dataclass(frozen=True, slots=True)
class BayesianEdges(NoMaintenance):
    """The posterior of each edge after what driving along it showed; nothing is pruned and nothing is added."""

    def after_attempt(self, graph: TopologicalGraph, attempt: AttemptEvidence) -> Deltas:
        """Return the new belief of the edge that was driven."""
        edge = graph.edges.get((attempt.source, attempt.target))
        if edge is None:
            return ()
        p = posterior(edge.belief.p, succeeded=attempt.succeeded)
        attempts, successes = edge.attempts + 1, edge.successes + attempt.succeeded
        belief = replace(edge.belief, p=p)
        return (BeliefUpdated(edge.source, edge.target, belief, attempts, successes, Cause.ATTEMPT),)


def posterior(p: float, *, succeeded: bool) -> float:
    """Return the probability of an edge after one more drive along it (Bayes)."""
    if_joined = ARRIVES_IF_JOINED if succeeded else 1 - ARRIVES_IF_JOINED
    if_not = ARRIVES_IF_NOT if succeeded else 1 - ARRIVES_IF_NOT
    return float(np.clip(p * if_joined / (p * if_joined + (1 - p) * if_not), _LEAST_P, 1 - _LEAST_P))


BRM = SystemEntry(name="brm", label="BRM", factory=brm_system)
