"""Which edges may not be open at a moment, and how probably each of them is.

Owns folding what a map knows of its edges. What is done with the answer is `graph.presence.presence_plan`.
"""

from collections.abc import Callable, Collection, Mapping
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
"""How probably edges are open now; all edges that are not in it are."""


class EdgePresence(Protocol):
    """Tells how probably edges are open."""

    def probabilities(self, graph: TopologicalGraph, now_s: float) -> EdgeProbabilities:
        """Return the edges that may not be open at a moment on the clock of the world."""
        ...

    def observe(self, graph: TopologicalGraph, obstruction: Obstruction, stamp: float) -> tuple[PresenceObserved, ...]:
        """Return what the map learns of something new that was seen from afar."""
        ...

    def observe_open(
        self, graph: TopologicalGraph, seen: Collection[EdgeKey], stamp: float
    ) -> tuple[PresenceObserved, ...]:
        """Return what the map learns of ways that were seen to be free."""
        ...


class AlwaysOpen:
    """Presence for a system that has no notion of it: every edge that exists is open."""

    def probabilities(self, graph: TopologicalGraph, now_s: float) -> EdgeProbabilities:
        """Return no edge."""
        return {}

    def observe(self, graph: TopologicalGraph, obstruction: Obstruction, stamp: float) -> tuple[PresenceObserved, ...]:
        """Return nothing."""
        return ()

    def observe_open(
        self, graph: TopologicalGraph, seen: Collection[EdgeKey], stamp: float
    ) -> tuple[PresenceObserved, ...]:
        """Return nothing."""
        return ()


ALWAYS_OPEN = AlwaysOpen()


class FilteredPresence:
    """What a filter makes of the observations that a map holds; an edge that was never seen blocked is open."""

    def __init__(self, presence_filter: PresenceFilter) -> None:
        """Know nothing of any map yet."""
        self.presence_filter = presence_filter
        self._known: dict[EdgeKey, tuple[PresenceObservation, ...]] = {}
        self._tracks: PresenceTracks = presence_filter.follow(0)

    def probabilities(self, graph: TopologicalGraph, now_s: float) -> EdgeProbabilities:
        """Return the edges that were ever seen blocked; linear in their number if none was seen since the last call."""
        if not graph.presence:
            return {}
        if graph.presence != self._known:
            self._known = dict(graph.presence)
            self._tracks = follow_histories(self.presence_filter, list(self._known.values()))
        # Where a recording goes on in another session its clock may begin anew.
        latest_s = max(seen[-1].stamp_s for seen in self._known.values())
        found = self._tracks.probability(max(now_s, latest_s))
        return dict(zip(self._known, map(float, found), strict=True))

    def observe(self, graph: TopologicalGraph, obstruction: Obstruction, stamp: float) -> tuple[PresenceObserved, ...]:
        """Return that the edges are blocked whose ways it closes."""
        return obstructed_deltas(graph, obstruction, stamp)

    def observe_open(
        self, graph: TopologicalGraph, seen: Collection[EdgeKey], stamp: float
    ) -> tuple[PresenceObserved, ...]:
        """Return that these edges are open, and others that the same things closed."""
        return seen_open_deltas(graph, seen, stamp)


class KnownPresence:
    """The truth of the moment, where somebody can tell: in simulation."""

    def __init__(self, closed_edges: Callable[[TopologicalGraph], Collection[EdgeKey]]) -> None:
        """Ask `closed_edges` which edges of a map are closed now."""
        self._closed_edges = closed_edges

    def probabilities(self, graph: TopologicalGraph, now_s: float) -> EdgeProbabilities:
        """Return the edges that are closed, each with 0."""
        return dict.fromkeys(self._closed_edges(graph), 0.0)

    def observe(self, graph: TopologicalGraph, obstruction: Obstruction, stamp: float) -> tuple[PresenceObserved, ...]:
        """Return nothing: the truth is known without looking."""
        return ()

    def observe_open(
        self, graph: TopologicalGraph, seen: Collection[EdgeKey], stamp: float
    ) -> tuple[PresenceObserved, ...]:
        """Return nothing, for the same reason."""
        return ()
