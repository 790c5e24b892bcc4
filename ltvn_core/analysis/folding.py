"""The map as the fold of its changes, for recordings of any health.

Owns what happens to a change that does not fit: it is left out and counted, where `TopologicalGraph` raises.
"""

from collections.abc import Iterable

from ltvn_core.analysis.records import Change
from ltvn_core.errors import MapError
from ltvn_core.graph.topograph import TopologicalGraph


class Folding:
    """A map that follows the changes, and begins anew with each map of the recording."""

    def __init__(self, graph: TopologicalGraph | None = None, epoch: int = 0) -> None:
        """Begin with a map of the run, which is changed from now on, or with an empty one."""
        self.graph = TopologicalGraph() if graph is None else graph
        self.misfits = 0
        """Changes that did not fit and were left out."""
        self._epoch = epoch

    def take(self, change: Change) -> None:
        """Follow a change; takes constant time, but for a node that leaves with many edges."""
        if change.epoch != self._epoch:
            self.graph, self._epoch = TopologicalGraph(), change.epoch
        try:
            self.graph.apply(change.delta)
        except MapError:
            self.misfits += 1


def folded(changes: Iterable[Change]) -> TopologicalGraph:
    """Return the map after `changes`; linear in them."""
    folding = Folding()
    for change in changes:
        folding.take(change)
    return folding.graph
