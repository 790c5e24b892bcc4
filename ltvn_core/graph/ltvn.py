"""The paper's own system: Algorithm 1, Dijkstra on d, the first node of the path, and lifelong maintenance.

Owns the composition of these parts, online mapping (the operators of Algorithm 1, one image at a time), the expansion
of the map where no path exists (a search through the reserve T'), and a maintenance that separates the existence of an
edge from its presence. Building is `graph.builder`, planning `graph.planner`, and learning from attempts
`graph.operators`.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ltvn_core.config import Method
from ltvn_core.geometry import agree, relative
from ltvn_core.graph import loop_closures
from ltvn_core.graph.builder import build
from ltvn_core.graph.deltas import (
    Cause,
    Edge,
    EdgeAdded,
    EdgePruned,
    FramesReleased,
    FramesReserved,
    GraphDelta,
    NodeAdded,
)
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.localiser import localise
from ltvn_core.graph.matching import Matcher, Matches
from ltvn_core.graph.navigation_system import Deltas, NavigationSystem, NoMaintenance, choose_first_node
from ltvn_core.graph.operators import (
    AttemptEvidence,
    connectable,
    mergeable,
    nearest_mergeable,
    node_from_observation,
    node_with_edges,
    novel_node,
    novel_thresholds,
    update_edge,
)
from ltvn_core.graph.planner import GraphPath, Planner, edge_cost, reachable_nodes
from ltvn_core.graph.presence.edge_presence import obstructed_deltas, open_deltas
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.types import Features, FrameId, NodeId, Observation, Predictor, is_usable

MAX_RETRIES_PER_NODE = 4
"""Number of reserved images that are tried again with each new node."""
SAMPLES, NEIGHBOURS = 60, 24
"""Most left-over images in one strict search for a path, and most nodes with which each is compared."""
MOST_RESERVED = 2000
"""Largest number of images in the reserve of a map that grows during driving."""
BRIDGES_TRIED = 12
"""Number of recently merged images with which an image without a neighbour is compared."""


class OnlineBuilder:
    """Merges, connects or keeps each image; apply the deltas of one image before offering the next."""

    def __init__(self, graph: TopologicalGraph, keyframes: KeyframeStore, predictor: Predictor, method: Method) -> None:
        """Grow `graph`; the reserve never holds more than `MOST_RESERVED` images."""
        self._graph = graph
        self._keyframes = keyframes
        self._matcher = Matcher(predictor, keyframes, method.matching)
        self._method = method
        self._thresholds = method.building
        self._pending: dict[FrameId, None] = {}
        self._merged: dict[FrameId, Matches] = {}
        """The images that merged last, each with the node that it merged with."""

    def offer(self, observation: Observation) -> tuple[GraphDelta, ...]:
        """Return the changes of an image: a node with its edges, a place in the reserve, or none.

        An image of a known frame changes nothing, nor does one without the depth that the predictor needs. Images
        without a neighbour are tried again when a node is added.
        """
        frame = observation.step
        is_known = frame in self._keyframes or frame in self._graph.nodes
        if is_known or not is_usable(observation, self._matcher.predictor):
            return ()
        self._keyframes.add([observation])
        if not self._graph.nodes:
            return (NodeAdded(node_from_observation(observation), Cause.ONLINE),)
        deltas = self._place(frame)
        if deltas:
            return (*deltas, *self._try_pending(frame))
        return tuple(self._keep(frame))

    def _place(self, frame: FrameId) -> Sequence[GraphDelta]:
        """Return the deltas of connecting a frame, none if it merges or finds no neighbour."""
        found = self._matcher.match(self._keyframes.features([frame]), tuple(self._graph.nodes))
        merging = nearest_mergeable(frame, found, self._matcher, self._thresholds)
        if merging is not None:
            self._merged[frame] = merging
            if len(self._merged) > BRIDGES_TRIED:
                del self._merged[next(iter(self._merged))]
            return []
        chosen = loop_closures.connections(frame, found, self._matcher, self._thresholds)
        if not len(chosen):
            return self._bridged(frame)
        return node_with_edges(self._keyframes.observation(frame), chosen, self._method.believing, Cause.ONLINE)

    def _bridged(self, frame: FrameId) -> list[GraphDelta]:
        """Return the deltas that join a frame through a merged image, see `graph.bridges`; without such an image, keep
        the frame pending."""
        graph = self._graph
        config = self._method
        known = [other for other, merging in self._merged.items() if merging.nodes[0] in graph.nodes]
        known = [other for other in known if other in graph.reserve and config.building.bridges]
        found = self._matcher.match(self._keyframes.features([frame]), known)
        chosen = loop_closures.connections(frame, found, self._matcher, self._thresholds)
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
        """Connect the latest left-over images to the new node where possible."""
        for frame in [*reversed(self._pending)][:MAX_RETRIES_PER_NODE]:
            if frame not in self._graph.reserve:  # It became a node, or left the reserve, in the meantime.
                del self._pending[frame]
                continue
            found = self._matcher.match(self._keyframes.features([frame]), (fresh,))
            chosen = loop_closures.connections(frame, found, self._matcher, self._thresholds)
            if len(chosen):
                del self._pending[frame]
                yield FramesReleased((frame,), Cause.ONLINE)
                seen = self._keyframes.observation(frame)
                yield from node_with_edges(seen, chosen, self._method.believing, Cause.ONLINE)

    def _keep(self, frame: FrameId) -> Iterator[GraphDelta]:
        """Put an image in the reserve and drop the oldest when it is full; merged images only if they are kept."""
        if frame not in self._pending and not self._method.building.keep_merged:
            self._keyframes.drop([frame])
            return
        reserve = self._graph.reserve
        if len(reserve) >= MOST_RESERVED:
            oldest = next(iter(reserve))
            self._pending.pop(oldest, None)
            self._keyframes.drop([oldest])
            yield FramesReleased((oldest,), Cause.ONLINE)
        yield FramesReserved((frame,), Cause.ONLINE)


def expand(
    graph: TopologicalGraph, source: NodeId, goal: NodeId, matcher: Matcher, method: Method, rng: np.random.Generator
) -> tuple[GraphDelta, ...]:
    """Return the deltas that join `source` to `goal` through images of the reserve; none without such a path."""
    if not graph.reserve or source not in graph.nodes or goal not in graph.nodes:
        return ()
    trial = graph.copy()
    planner = Planner(trial, method.planning)
    added = dict[FrameId, Deltas]()
    for frame in _candidates(graph, source, goal, method, rng):
        deltas = _connecting_deltas(trial, frame, matcher, method)
        if deltas is None:
            continue
        for delta in deltas:
            trial.apply(delta)
        added[frame] = deltas
        path = planner.plan(source, goal)
        if path.nodes:
            return _restricted_to_path(path, added, graph)
    return ()


def _candidates(
    graph: TopologicalGraph, source: NodeId, goal: NodeId, method: Method, rng: np.random.Generator
) -> list[FrameId]:
    """Order the reserve: at random, or first the images that lie in time between reached and unreached nodes."""
    frames = np.array(sorted(graph.reserve))
    if not method.expanding.strict:
        return rng.permutation(frames).tolist()
    onward, back = reachable_nodes(graph, source), reachable_nodes(graph, goal, backwards=True)
    gap = _steps_to_nearest_node(frames, onward) + _steps_to_nearest_node(frames, back)
    return frames[np.argsort(gap, kind="stable")[:SAMPLES]].tolist()


def _steps_to_nearest_node(frames: np.ndarray, nodes: set[NodeId]) -> np.ndarray:
    """Return (N,) steps from each frame to the node nearest in time."""
    ordered = np.array(sorted(nodes))
    after = np.searchsorted(ordered, frames)
    before = ordered[np.maximum(after - 1, 0)]
    return np.minimum(np.abs(frames - before), np.abs(frames - ordered[np.minimum(after, len(ordered) - 1)]))


def _connecting_deltas(trial: TopologicalGraph, frame: FrameId, matcher: Matcher, method: Method) -> Deltas | None:
    """Return the deltas that make a frame a node of the trial map; None if it adds nothing or is not trusted."""
    nodes = sorted(trial.nodes, key=lambda node: abs(node - frame))
    nodes = nodes[:NEIGHBOURS] if method.expanding.strict else nodes
    matches = matcher.match(matcher.keyframes.features([frame]), nodes)
    thresholds = novel_thresholds(method.building)
    if method.expanding.strict:
        # Merged images help here: they are in the reserve because they look like a node, and so bridge gaps.
        chosen = loop_closures.connections(frame, matches, matcher, thresholds)
        least = 2
    else:
        chosen = matches.take(connectable(matches, thresholds) & ~mergeable(matches, thresholds).any())
        least = 1
    if len(chosen) < least:
        return None
    seen = matcher.keyframes.observation(frame)
    released = FramesReleased((frame,), Cause.EXPAND)
    return released, *node_with_edges(seen, chosen, method.believing, Cause.EXPAND)


def _restricted_to_path(path: GraphPath, added: Mapping[FrameId, Deltas], graph: TopologicalGraph) -> Deltas:
    """Keep the new nodes on the path, and of their edges those between nodes that stay."""
    staying = set(path.nodes) | set(graph.nodes)
    kept = (delta for frame, deltas in added.items() if frame in staying for delta in deltas)
    return tuple(
        delta for delta in kept if not isinstance(delta, EdgeAdded) or {delta.edge.source, delta.edge.target} <= staying
    )


def ltvn_system(method: Method) -> NavigationSystem:
    """Return the paper's system; its map stays as it is if the method does not maintain."""
    return NavigationSystem(
        name="ltvn",
        method=method,
        build=partial(build, method=method),
        edge_weight=partial(edge_cost, config=method.planning),
        localise=partial(localise, config=method.localising),
        subgoal=choose_first_node,
        maintenance=LifelongMaintenance(method) if method.maintain else NoMaintenance(),
        online=partial(OnlineBuilder, method=method),
        follows_places=method.localising.follow_places,
    )


@dataclass(frozen=True, slots=True)
class LifelongMaintenance:
    """Eq. 3 and Eq. 4, pruning, novel nodes and the search through the reserve."""

    method: Method

    def after_attempt(self, graph: TopologicalGraph, attempt: AttemptEvidence) -> Deltas:
        """Update the belief of the edge, and prune it after too many failures."""
        return update_edge(graph, attempt, self.method.believing)

    def no_path(
        self, graph: TopologicalGraph, source: NodeId, goal: NodeId, matcher: Matcher, rng: np.random.Generator
    ) -> Deltas:
        """Search the reserve for a path."""
        if not self.method.expanding.search_reserve:
            return ()
        return expand(graph, source, goal, matcher, self.method, rng)

    def unrecognised(
        self, graph: TopologicalGraph, seen: Observation, features: Features, looks: int, matcher: Matcher
    ) -> Deltas:
        """Make a node of the image once looking around has not helped."""
        patience = self.method.expanding.novel_after_looks
        return novel_node(graph, seen, features, matcher, self.method) if 0 < patience <= looks else ()


_SAME_PLACE = (0.4, 0.4)
"""Largest difference from odometry, in metres and radians, at which an edge between consecutive images counts as driven
during mapping."""
_LEAST_FAILURES = 3
"""Least number of queries in which an edge has failed before it may be pruned permanently."""


class PresenceMaintenance(LifelongMaintenance):
    """The paper's maintenance, except that obstacles change presence and not existence."""

    def after_attempt(self, graph: TopologicalGraph, attempt: AttemptEvidence) -> Deltas:
        """Return an observation of presence or else an updated belief; prune only an edge that was never driven."""
        if attempt.obstruction is not None and not attempt.succeeded:
            blocked = obstructed_deltas(graph, attempt.obstruction, attempt.stamp, driven=_driven(attempt))
            if any((each.source, each.target) == _driven(attempt) for each in blocked):
                return blocked
            # New things in view make a place hard to recognise, so the failure is only weak evidence against the edge.
            return (*blocked, *self._believe(graph, replace(attempt, hindered=True)))
        opened = open_deltas(graph, _driven(attempt), attempt.stamp) if attempt.succeeded else ()
        return (*opened, *self._believe(graph, attempt))

    def _believe(self, graph: TopologicalGraph, attempt: AttemptEvidence) -> Deltas:
        updates = super().after_attempt(graph, attempt)
        kept = (each for each in updates if not isinstance(each, EdgePruned) or never_existed(graph, each))
        return tuple(kept)


def _driven(attempt: AttemptEvidence) -> EdgeKey:
    return attempt.source, attempt.target


def never_existed(graph: TopologicalGraph, pruned: EdgePruned) -> bool:
    """Return whether an edge to be pruned has probably never existed."""
    edge = graph.edges[pruned.source, pruned.target]
    # The current failure is not counted in the map yet.
    failures = edge.attempts + 1
    seen_blocked = (edge.source, edge.target) in graph.presence
    return failures >= _LEAST_FAILURES and not seen_blocked and not _was_driven(graph, edge)


def _was_driven(graph: TopologicalGraph, edge: Edge) -> bool:
    """Return whether an edge was driven successfully, or during mapping.

    The latter is so if it joins two consecutive images and agrees with odometry between them.
    """
    if edge.successes:
        return True
    first, last = sorted((edge.source, edge.target))
    if any(first < node < last for node in graph.nodes):
        return False
    source, target = (np.array(graph.nodes[node].odometry) for node in (edge.source, edge.target))
    return bool(agree(relative(source, target), np.array(edge.waypoint), _SAME_PLACE))
