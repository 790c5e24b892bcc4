"""BRM (Wu et al. 2019), "Bayesian Relational Memory", as far as it applies to a map of images.

Owns its belief: an edge is a Bernoulli variable, an attempt to drive along it is a noisy observation, and the path is
the most probable one. In BRM, nodes are types of rooms, predicted by a classifier; here they are the images of our own
map, with BRM's constants of observation noise. This compares its update and its planning with ours. As a maintenance it
can also use an oracle for the rooms of its nodes, and keep beliefs about connections between rooms.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from ltvn_core.graph.deltas import BeliefUpdated, Cause, Edge
from ltvn_core.graph.navigation_system import Deltas, NoMaintenance
from ltvn_core.graph.operators import AttemptEvidence
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.types import NodeId

ARRIVES_IF_JOINED, ARRIVES_IF_NOT = 0.95, 0.001
"""Probability of arriving along an edge that exists, and along one that does not."""
_LEAST_P = 1e-6

RoomOf: TypeAlias = Callable[[NodeId], int | None]
"""Returns the room of a node; None between rooms."""


@dataclass(frozen=True, slots=True)
class BayesianEdges(NoMaintenance):
    """Updates the posterior of each edge after an attempt; prunes and adds no edge."""

    room_of: RoomOf | None = None
    """Function that returns the room of a node; None if rooms are unknown. As in BRM, two rooms are connected or not,
    so an attempt to drive from one to the other updates all edges between them."""

    def after_attempt(self, graph: TopologicalGraph, attempt: AttemptEvidence) -> Deltas:
        """Return the new beliefs of the driven edge, and of all edges between the same rooms."""
        driven = attempt.source, attempt.target
        if driven not in graph.edges:
            return ()
        return tuple(
            _updated(graph.edges[key], succeeded=attempt.succeeded, attempts=int(key == driven))
            for key in (driven, *self._edges_beside(graph, driven))
        )

    def _edges_beside(self, graph: TopologicalGraph, driven: EdgeKey) -> Iterator[EdgeKey]:
        """Yield the other edges between the same two rooms, in the same direction."""
        if self.room_of is None:
            return
        rooms = self._rooms(driven)
        if None not in rooms and rooms[0] != rooms[1]:
            yield from (key for key in graph.edges if key != driven and self._rooms(key) == rooms)

    def _rooms(self, ends: EdgeKey) -> tuple[int | None, int | None]:
        assert self.room_of is not None
        return self.room_of(ends[0]), self.room_of(ends[1])


def _updated(edge: Edge, *, succeeded: bool, attempts: int) -> BeliefUpdated:
    """Return the new belief of an edge, with `attempts` added to its own attempts."""
    belief = replace(edge.belief, p=posterior(edge.belief.p, succeeded=succeeded))
    successes = edge.successes + attempts * succeeded
    return BeliefUpdated(edge.source, edge.target, belief, edge.attempts + attempts, successes, Cause.ATTEMPT)


def posterior(p: float, *, succeeded: bool) -> float:
    """Return the probability of an edge after one more drive along it (Bayes)."""
    if_joined = ARRIVES_IF_JOINED if succeeded else 1 - ARRIVES_IF_JOINED
    if_not = ARRIVES_IF_NOT if succeeded else 1 - ARRIVES_IF_NOT
    return float(np.clip(p * if_joined / (p * if_joined + (1 - p) * if_not), _LEAST_P, 1 - _LEAST_P))
