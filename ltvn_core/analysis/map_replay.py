"""The map of a recording, replayed from its changes, and the boundaries between its maps.

A change that does not fit is skipped, whereas `TopologicalGraph` raises an error. A recording holds several maps if
another one was loaded, or if the map was rebuilt.
"""

from ltvn_core.analysis.timeline_records import MapChange
from ltvn_core.errors import MapError
from ltvn_core.graph.deltas import BULK_CAUSES, Cause, EdgeAdded, GraphDelta, NodeAdded, NodeDropped
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.types import NodeId


class MapReplay:
    """A map that is replayed change by change, and is empty again when the next map begins."""

    def __init__(self) -> None:
        """Begin with an empty map."""
        self.graph = TopologicalGraph()
        self._epoch = 0

    def copy(self) -> "MapReplay":
        """Return an independent copy at the same change."""
        twin = MapReplay()
        twin.graph = self.graph.copy()
        twin._epoch = self._epoch
        return twin

    def take(self, change: MapChange) -> bool:
        """Apply a change; tell whether it fits. Constant time, except for the removal of a node with many edges."""
        if change.epoch != self._epoch:
            self.graph = TopologicalGraph()
            self._epoch = change.epoch
        try:
            self.graph.apply(change.delta)
        except MapError:
            return False
        return True


class MapEpochs:
    """Counts the maps of a recording and the changes of each map."""

    def __init__(self) -> None:
        """Start before the first map."""
        self.current = 0
        """Index of the map to which the last change belongs."""
        self.version = 0
        """Number of changes of the current map so far."""
        self._last: GraphDelta | None = None
        self._nodes: set[NodeId] = set()

    def take(self, delta: GraphDelta) -> bool:
        """Count a change; tell whether a whole map begins with it."""
        fresh = isinstance(delta, NodeAdded) and delta.cause in BULK_CAUSES and self._begins(delta)
        if fresh and self._last is not None:
            self.current += 1
            self.version = 0
            self._nodes.clear()
        self._last = delta
        self.version += 1
        if isinstance(delta, NodeAdded):
            self._nodes.add(delta.node.id)
        elif isinstance(delta, NodeDropped):
            self._nodes.discard(delta.node)
        return fresh

    def _begins(self, delta: NodeAdded) -> bool:
        last = self._last
        if last is None or last.cause is not delta.cause or delta.node.id in self._nodes:
            return True
        # A loaded map adds all its nodes before its edges; a map that is being built adds each node with its edges.
        allowed = NodeAdded if delta.cause is Cause.LOAD else NodeAdded | EdgeAdded
        return not isinstance(last, allowed)
