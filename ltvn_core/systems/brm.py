"""BRM (Wu et al. 2019), "Bayesian Relational Memory", as far as a map of images has what it needs.

Owns its belief: an edge is a Bernoulli variable, what driving along it shows is a noisy observation of it, and the path
is the most probable one. Its nodes are kinds of rooms, named by a classifier; here they are the images of our own map,
and its numbers of observation noise are kept. So it tells what its update and its planning are worth beside ours. As a
maintenance it can also ask an oracle which rooms its nodes lie in, and believe in ways between rooms.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from ltvn_core.config import Method
from ltvn_core.graph.deltas import BeliefUpdated, Cause, Edge
from ltvn_core.graph.ltvn import ltvn_system
from ltvn_core.graph.maintenance import AttemptEvidence
from ltvn_core.graph.navigation_system import Deltas, NavigationSystem, NoMaintenance
from ltvn_core.graph.planner import surprise_cost
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.systems.entry import SystemEntry
from ltvn_core.types import NodeId

ARRIVES_IF_JOINED, ARRIVES_IF_NOT = 0.95, 0.001
"""Probability of arriving along an edge that is there, and along one that is not."""
_LEAST_P = 1e-6

RoomOf: TypeAlias = Callable[[NodeId], int | None]
"""Returns the room that a node lies in, None between rooms."""


def brm_system(method: Method) -> NavigationSystem:
    """Return BRM on the map of our own system; `method` has all thresholds."""
    maintenance = BayesianEdges() if method.maintain else NoMaintenance()
    return replace(ltvn_system(method), name="brm", edge_weight=surprise_cost, maintenance=maintenance, online=None)


@dataclass(frozen=True, slots=True)
class BayesianEdges(NoMaintenance):
    """The posterior of each edge after what driving along it showed; nothing is pruned and nothing is added."""

    room_of: RoomOf | None = None
    """Tells the rooms of nodes. Two rooms are joined or not, as in BRM, so what driving from one to the other showed
    holds for all edges between them. None where nobody knows rooms."""

    def after_attempt(self, graph: TopologicalGraph, attempt: AttemptEvidence) -> Deltas:
        """Return the new belief of the edge that was driven, and of those between the same rooms."""
        driven = attempt.source, attempt.target
        if driven not in graph.edges:
            return ()
        return tuple(
            _updated(graph.edges[key], succeeded=attempt.succeeded, attempts=int(key == driven))
            for key in (driven, *self._edges_beside(graph, driven))
        )

    def _edges_beside(self, graph: TopologicalGraph, driven: EdgeKey) -> Iterator[EdgeKey]:
        """Yield the other edges that lead from the same room to the same other room."""
        if self.room_of is None:
            return
        rooms = self._rooms(driven)
        if None not in rooms and rooms[0] != rooms[1]:
            yield from (key for key in graph.edges if key != driven and self._rooms(key) == rooms)

    def _rooms(self, ends: EdgeKey) -> tuple[int | None, int | None]:
        assert self.room_of is not None
        return self.room_of(ends[0]), self.room_of(ends[1])


def _updated(edge: Edge, *, succeeded: bool, attempts: int) -> BeliefUpdated:
    """Return the new belief of an edge, of whose own attempts there were so many more."""
    belief = replace(edge.belief, p=posterior(edge.belief.p, succeeded=succeeded))
    successes = edge.successes + attempts * succeeded
    return BeliefUpdated(edge.source, edge.target, belief, edge.attempts + attempts, successes, Cause.ATTEMPT)


def posterior(p: float, *, succeeded: bool) -> float:
    """Return the probability of an edge after one more drive along it (Bayes)."""
    if_joined = ARRIVES_IF_JOINED if succeeded else 1 - ARRIVES_IF_JOINED
    if_not = ARRIVES_IF_NOT if succeeded else 1 - ARRIVES_IF_NOT
    return float(np.clip(p * if_joined / (p * if_joined + (1 - p) * if_not), _LEAST_P, 1 - _LEAST_P))


BRM = SystemEntry(name="brm", label="BRM", factory=brm_system)
