"""The map at any moment of a long run, without folding it from the start each time.

Owns which maps are kept. A few are, whatever the length of the run, so that memory does not grow with it.
"""

from bisect import bisect_right
from collections.abc import Sequence

from ltvn_core.analysis.folding import Folding
from ltvn_core.analysis.records import Change
from ltvn_core.graph.topograph import TopologicalGraph

KEPT = 8
_LEAST = 2_000
"""Changes between two kept maps; fewer are folded faster than a map is copied."""


class Checkpoints:
    """Maps along a list of changes."""

    def __init__(self, changes: Sequence[Change], epochs: Sequence[int]) -> None:
        """Keep none yet; `epochs` says where in `changes` each map of the run begins."""
        self._changes, self._epochs = changes, epochs
        self._spacing = max(_LEAST, -(-len(changes) // KEPT))
        self._kept: dict[int, TopologicalGraph] = {}

    def at(self, count: int) -> TopologicalGraph:
        """Return a map of one's own after the first `count` changes.

        The first time linear in them; then a copy of the nearest map that was kept, and the changes since it.
        """
        if not count:
            return TopologicalGraph()
        begin = self._epochs[bisect_right(self._epochs, count - 1) - 1]
        # Another thread may be keeping maps, too, so the list of them is taken once.
        known = max((place for place in [*self._kept] if begin < place <= count), default=begin)
        graph = self._kept[known].copy() if known > begin else TopologicalGraph()
        folding = Folding(graph, self._changes[count - 1].epoch)
        for place in range(known, count):
            folding.take(self._changes[place])
            if (place + 1) % self._spacing == 0:
                self._kept.setdefault(place + 1, folding.graph.copy())
        return folding.graph
