"""The map while somebody drives: the operators of Algorithm 1, one image at a time.

Owns what is kept for later and how much. Does not apply its deltas: whoever owns the map does, before the next image.
"""

from collections.abc import Iterator

from ltvn_core.config import Method
from ltvn_core.graph.closures import Closures
from ltvn_core.graph.deltas import Cause, FramesReleased, FramesReserved, GraphDelta, NodeAdded
from ltvn_core.graph.matching import Matcher, Matches
from ltvn_core.graph.operators import Gates, connectable, mergeable, node_of, node_with_edges
from ltvn_core.graph.topograph import TopologicalGraph
from ltvn_core.graph.views import Views
from ltvn_core.types import FrameId, Observation, Predictor

RETRIES = 4
"""Images kept for later that are tried again with each new node."""


class OnlineBuilder:
    """Merges, connects or keeps each image; apply the deltas of one image before offering the next."""

    def __init__(
        self,
        graph: TopologicalGraph,
        views: Views,
        predictor: Predictor,
        method: Method,
        *,
        reserve_limit: int = 2000,
    ) -> None:
        """Grow `graph`; the reserve never holds more than `reserve_limit` images."""
        self._graph = graph
        self._views = views
        self._matcher = Matcher(predictor, views, method.matching)
        self._closures = Closures(self._matcher)
        self._method = method
        self._gates = Gates.building(method.building)
        self._reserve_limit = reserve_limit
        self._pending: dict[FrameId, None] = {}

    def offer(self, observation: Observation) -> tuple[GraphDelta, ...]:
        """Return what an image changes: a node with its edges, or its place in the reserve, or nothing.

        An image whose frame is known already changes nothing. Images that had no neighbour before are tried again
        when a node comes in.
        """
        frame = observation.step
        if frame in self._views or frame in self._graph.nodes:
            return ()
        self._views.add([observation])
        if not self._graph.nodes:
            return (NodeAdded(node_of(observation), Cause.ONLINE),)
        fate = self._place(frame)
        if fate:
            return (*fate, *self._try_pending(frame))
        return tuple(self._keep(frame))

    def _place(self, frame: FrameId) -> list[GraphDelta]:
        """Return the deltas of connecting a frame, none if it merges or finds no neighbour."""
        found = self._matcher.match(self._views.features([frame]), tuple(self._graph.nodes))
        likely = mergeable(found, self._gates) | connectable(found, self._gates)
        found = self._matcher.supported(found.take(likely), frame)
        if mergeable(found, self._gates).any():
            return []
        chosen = self._connected(found, frame)
        if not len(chosen):
            self._pending[frame] = None
            return []
        return node_with_edges(self._views.observation(frame), chosen, self._method.believing, Cause.ONLINE)

    def _connected(self, found: Matches, frame: FrameId) -> Matches:
        """Return the matches of a frame that become edges."""
        proven = self._closures.proven(frame, found, connectable(found, self._gates))
        return proven.take(connectable(proven, self._gates))

    def _try_pending(self, fresh: FrameId) -> Iterator[GraphDelta]:
        """Tie the latest left-over images to the node that just came in, where they fit."""
        for frame in [*reversed(self._pending)][:RETRIES]:
            if frame not in self._graph.reserve:  # Something else made a node of it, or let it go.
                del self._pending[frame]
                continue
            found = self._matcher.match(self._views.features([frame]), (fresh,))
            found = self._matcher.supported(found.take(connectable(found, self._gates)), frame)
            chosen = self._connected(found, frame)
            if len(chosen):
                del self._pending[frame]
                yield FramesReleased((frame,), Cause.ONLINE)
                seen = self._views.observation(frame)
                yield from node_with_edges(seen, chosen, self._method.believing, Cause.ONLINE)

    def _keep(self, frame: FrameId) -> Iterator[GraphDelta]:
        """Put an image in the reserve, letting the oldest go when that is full; merged ones only if they are kept."""
        if frame not in self._pending and not self._method.building.keep_merged:
            self._views.drop([frame])
            return
        reserve = self._graph.reserve
        if reserve and len(reserve) >= self._reserve_limit:
            oldest = next(iter(reserve))
            self._pending.pop(oldest, None)
            self._views.drop([oldest])
            yield FramesReleased((oldest,), Cause.ONLINE)
        yield FramesReserved((frame,), Cause.ONLINE)
