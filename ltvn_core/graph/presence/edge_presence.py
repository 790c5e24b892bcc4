"""Presence of edges: p(open) at a moment, for the edges that may be closed.

Owns running the filter over the observations in a map. The planner that uses the result is
`graph.presence.presence_plan`.
"""

from collections.abc import Collection, Mapping
from typing import Protocol, TypeAlias

from ltvn_core.graph.deltas import PresenceObserved
from ltvn_core.graph.presence.obstruction import Obstruction
from ltvn_core.graph.presence.presence_filter import (
    PresenceFilter,
    PresenceObservation,
    PresenceTracks,
    follow_histories,
)
from ltvn_core.graph.presence.presence_observations import obstructed_deltas, seen_open_deltas
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph

EdgeProbabilities: TypeAlias = Mapping[EdgeKey, float]
"""p(open) of each edge that may be closed; all other edges are open."""


class EdgePresence(Protocol):
    """Predicts p(open) of edges."""

    def probabilities(self, graph: TopologicalGraph, now_s: float) -> EdgeProbabilities:
        """Return p(open) of the edges that may be closed at a moment on the clock of the world."""
        ...

    def observe(self, graph: TopologicalGraph, obstruction: Obstruction, stamp: float) -> tuple[PresenceObserved, ...]:
        """Return the deltas for an obstacle that was seen from afar."""
        ...

    def observe_open(
        self, graph: TopologicalGraph, seen: Collection[EdgeKey], stamp: float
    ) -> tuple[PresenceObserved, ...]:
        """Return the deltas for edges whose paths were seen to be free."""
        ...


class UnobservedPresence:
    """Base of presences that need no observations."""

    def observe(self, graph: TopologicalGraph, obstruction: Obstruction, stamp: float) -> tuple[PresenceObserved, ...]:
        """Return nothing."""
        return ()

    def observe_open(
        self, graph: TopologicalGraph, seen: Collection[EdgeKey], stamp: float
    ) -> tuple[PresenceObserved, ...]:
        """Return nothing."""
        return ()


class AlwaysOpen(UnobservedPresence):
    """Presence for a system that does not model it: every edge that exists is open."""

    def probabilities(self, graph: TopologicalGraph, now_s: float) -> EdgeProbabilities:
        """Return no edge."""
        return {}


ALWAYS_OPEN = AlwaysOpen()


class FilteredPresence:
    """Presence from a filter over the observations in a map; an edge that was never seen blocked is open."""

    def __init__(self, presence_filter: PresenceFilter) -> None:
        """Start without a map."""
        self.presence_filter = presence_filter
        self._known: dict[EdgeKey, tuple[PresenceObservation, ...]] = {}
        self._tracks: PresenceTracks = presence_filter.follow(0)

    def probabilities(self, graph: TopologicalGraph, now_s: float) -> EdgeProbabilities:
        """Return p(open) of the edges that were ever seen blocked; linear in their number without new observations."""
        if not graph.presence:
            return {}
        if graph.presence != self._known:
            self._known = dict(graph.presence)
            self._tracks = follow_histories(self.presence_filter, list(self._known.values()))
        # When a recording continues in another session, its clock may restart.
        latest_s = max(seen[-1].stamp_s for seen in self._known.values())
        found = self._tracks.probability(max(now_s, latest_s))
        return dict(zip(self._known, map(float, found), strict=True))

    def observe(self, graph: TopologicalGraph, obstruction: Obstruction, stamp: float) -> tuple[PresenceObserved, ...]:
        """Return observations that all edges closed by the obstacle are blocked."""
        return obstructed_deltas(graph, obstruction, stamp)

    def observe_open(
        self, graph: TopologicalGraph, seen: Collection[EdgeKey], stamp: float
    ) -> tuple[PresenceObserved, ...]:
        """Return observations that these edges, and others closed by the same obstacle, are open."""
        return seen_open_deltas(graph, seen, stamp)
