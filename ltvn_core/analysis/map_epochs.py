"""Where one map of a recording ends and the next begins.

A recording holds two maps when another one was loaded, or when the map was built anew. Owns that decision alone.
"""

from ltvn_core.graph.deltas import BULK_CAUSES, Cause, EdgeAdded, GraphDelta, NodeAdded, NodeDropped
from ltvn_core.types import NodeId


class MapEpochs:
    """Counts maps, change after change."""

    def __init__(self) -> None:
        """Begin before the first map."""
        self.current = 0
        self.version = 0
        """Changes in the current map so far."""
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
        # A file's map tells all its nodes before its edges; a building one brings each node with its edges.
        allowed = NodeAdded if delta.cause is Cause.LOAD else NodeAdded | EdgeAdded
        return not isinstance(last, allowed)
