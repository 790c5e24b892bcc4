"""The map while somebody drives: the operators of Algorithm 1, one image at a time.

Owns what is kept for later and how much. Does not apply its deltas: whoever owns the map does, before the next image.
"""

from collections.abc import Iterator

import numpy as np

from ltvn_core.config import Method
from ltvn_core.graph.deltas import Cause, FramesReleased, FramesReserved, GraphDelta, NodeAdded
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.loop_closures import LoopClosureVerifier
from ltvn_core.graph.matching import Matcher, Matches
from ltvn_core.graph.operators import OperatorThresholds, connectable, mergeable, node_from_observation, node_with_edges
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.types import FrameId, Observation, Predictor, is_usable

MAX_RETRIES_PER_NODE = 4
"""Images kept for later that are tried again with each new node."""
BRIDGES_TRIED = 12
"""An image without a neighbour is compared with so many images that merged last: it may hang on one of them."""


class OnlineBuilder:
    """Merges, connects or keeps each image; apply the deltas of one image before offering the next."""

    def __init__(
        self,
        graph: TopologicalGraph,
        keyframes: KeyframeStore,
        predictor: Predictor,
        method: Method,
        *,
        reserve_limit: int = 2000,
    ) -> None:
        """Grow `graph`; the reserve never holds more than `reserve_limit` images."""
        self._graph = graph
        self._keyframes = keyframes
        self._predictor = predictor
        self._matcher = Matcher(predictor, keyframes, method.matching)
        self._loop_closures = LoopClosureVerifier(self._matcher)
        self._method = method
        self._thresholds = OperatorThresholds.building(method.building)
        self._reserve_limit = reserve_limit
        self._pending: dict[FrameId, None] = {}
        self._merged: dict[FrameId, Matches] = {}
        """The images that merged last, each with the node that it adds nothing to."""

    def offer(self, observation: Observation) -> tuple[GraphDelta, ...]:
        """Return what an image changes: a node with its edges, or its place in the reserve, or nothing.

        An image whose frame is known already changes nothing, nor one without the depth that the predictor needs.
        Images that had no neighbour before are tried again when a node comes in.
        """
        frame = observation.step
        if frame in self._keyframes or frame in self._graph.nodes or not is_usable(observation, self._predictor):
            return ()
        self._keyframes.add([observation])
        if not self._graph.nodes:
            return (NodeAdded(node_from_observation(observation), Cause.ONLINE),)
        deltas = self._place(frame)
        if deltas:
            return (*deltas, *self._try_pending(frame))
        return tuple(self._keep(frame))

    def _place(self, frame: FrameId) -> list[GraphDelta]:
        """Return the deltas of connecting a frame, none if it merges or finds no neighbour."""
        found = self._matcher.match(self._keyframes.features([frame]), tuple(self._graph.nodes))
        likely = mergeable(found, self._thresholds) | connectable(found, self._thresholds)
        found = self._matcher.with_mutual_support(found.take(likely), frame)
        merging = found.take(mergeable(found, self._thresholds))
        if len(merging):
            self._remember_merged(frame, merging.take(np.array([merging.distances.argmin()])))
            return []
        chosen = self._loop_closures.verified(frame, found, connectable(found, self._thresholds))
        chosen = chosen.take(connectable(chosen, self._thresholds))
        if not len(chosen):
            return self._bridged(frame)
        return node_with_edges(self._keyframes.observation(frame), chosen, self._method.believing, Cause.ONLINE)

    def _remember_merged(self, frame: FrameId, merging: Matches) -> None:
        self._merged[frame] = merging
        if len(self._merged) > BRIDGES_TRIED:
            del self._merged[next(iter(self._merged))]

    def _bridged(self, frame: FrameId) -> list[GraphDelta]:
        """Return the deltas that join a frame by way of a merged image, see `graph.bridges`; without any it waits."""
        graph, config = self._graph, self._method
        known = [other for other, merging in self._merged.items() if merging.nodes[0] in graph.nodes]
        known = [other for other in known if other in graph.reserve and config.building.bridges]
        found = self._matcher.match(self._keyframes.features([frame]), known)
        chosen = self._loop_closures.connections(frame, found, self._thresholds)
        if not len(chosen):
            self._pending[frame] = None
            return []
        chosen = chosen.take(np.array([chosen.reachability.argmax()]))
        (other,) = chosen.nodes
        return [
            FramesReleased((other,), Cause.ONLINE),
            *node_with_edges(
                self._keyframes.observation(other), self._merged.pop(other), config.believing, Cause.ONLINE
            ),
            *node_with_edges(self._keyframes.observation(frame), chosen, config.believing, Cause.ONLINE),
        ]

    def _try_pending(self, fresh: FrameId) -> Iterator[GraphDelta]:
        """Tie the latest left-over images to the node that just came in, where they fit."""
        for frame in [*reversed(self._pending)][:MAX_RETRIES_PER_NODE]:
            if frame not in self._graph.reserve:  # Something else made a node of it, or let it go.
                del self._pending[frame]
                continue
            found = self._matcher.match(self._keyframes.features([frame]), (fresh,))
            chosen = self._loop_closures.connections(frame, found, self._thresholds)
            if len(chosen):
                del self._pending[frame]
                yield FramesReleased((frame,), Cause.ONLINE)
                seen = self._keyframes.observation(frame)
                yield from node_with_edges(seen, chosen, self._method.believing, Cause.ONLINE)

    def _keep(self, frame: FrameId) -> Iterator[GraphDelta]:
        """Put an image in the reserve, letting the oldest go when that is full; merged ones only if they are kept."""
        if frame not in self._pending and not self._method.building.keep_merged:
            self._keyframes.drop([frame])
            return
        reserve = self._graph.reserve
        if reserve and len(reserve) >= self._reserve_limit:
            oldest = next(iter(reserve))
            self._pending.pop(oldest, None)
            self._keyframes.drop([oldest])
            yield FramesReleased((oldest,), Cause.ONLINE)
        yield FramesReserved((frame,), Cause.ONLINE)
