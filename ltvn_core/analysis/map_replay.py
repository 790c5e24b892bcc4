"""The map as the fold of its changes, for recordings of any health.

Owns what happens to a change that does not fit: it is left out and counted, where `TopologicalGraph` raises.
"""

from collections.abc import Sequence

from ltvn_core.analysis.timeline_records import MapChange
from ltvn_core.errors import MapError
from ltvn_core.graph.topological_graph import TopologicalGraph

_STRIDE = 10_000
"""A map is kept after so many changes; folding as many takes some tens of milliseconds."""
_MOST_KEPT = 12
"""A map of 10,000 nodes and 50,000 edges takes some 10 MB."""


class MapReplay:
    """A map that follows the changes, and begins anew with each map of the recording."""

    def __init__(self) -> None:
        """Begin with an empty map."""
        self.graph = TopologicalGraph()
        self.skipped_changes = 0
        """Changes that did not fit and were left out."""
        self._epoch = 0

    def copy(self) -> "MapReplay":
        """Return an independent one that stands at the same change."""
        twin = MapReplay()
        twin.graph, twin.skipped_changes, twin._epoch = self.graph.copy(), self.skipped_changes, self._epoch
        return twin

    def take(self, change: MapChange) -> None:
        """Follow a change; takes constant time, but for a node that leaves with many edges."""
        if change.epoch != self._epoch:
            self.graph, self._epoch = TopologicalGraph(), change.epoch
        try:
            self.graph.apply(change.delta)
        except MapError:
            self.skipped_changes += 1


class MapReplayCache:
    """Maps as they were at some times, to fold on from there: time travel without beginning at the beginning."""

    def __init__(self) -> None:
        """Remember nothing yet."""
        self._kept: dict[int, MapReplay] = {}

    def after(self, changes: Sequence[MapChange], count: int) -> TopologicalGraph:
        """Return the map after the first `count` changes; at most `_STRIDE` are folded once those before were.

        `changes` may have grown since the last time, but must begin as they did.
        """
        kept = self._kept  # Another thread may thin them out meanwhile.
        known = max((place for place in tuple(kept) if place <= count), default=0)
        folding = kept[known].copy() if known else MapReplay()
        for place in range(known, count):
            folding.take(changes[place])
            if (place + 1) % _STRIDE == 0:
                self._keep(place + 1, folding.copy())
        return folding.graph

    def _keep(self, place: int, folding: MapReplay) -> None:
        self._kept[place] = folding
        if len(self._kept) > _MOST_KEPT:
            # Every second one goes, so that what is left is still spread over the whole run.
            self._kept = {place: self._kept[place] for place in sorted(self._kept)[1::2]}
