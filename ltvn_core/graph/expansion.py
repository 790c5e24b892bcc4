"""Map expansion where no path exists: search one through the reserve T', and keep only the images on it.

Owns the search. It works on a copy, so a search that finds nothing changes nothing. Searching until anything fits is a
search for false edges, so the robust method keeps the strict cut, asks for two supports and searches near in time
first.
"""

from collections.abc import Sequence
from typing import assert_never

import numpy as np

from ltvn_core.config import Method
from ltvn_core.graph.deltas import (
    BeliefUpdated,
    Cause,
    DriveBegun,
    EdgeAdded,
    EdgeProtected,
    EdgePruned,
    FramesReleased,
    FramesReserved,
    GraphDelta,
    NodeAdded,
    NodeDropped,
    NodeNamed,
    PresenceObserved,
    ViewAdded,
    ViewDropped,
    ViewUsed,
)
from ltvn_core.graph.loop_closures import LoopClosureVerifier
from ltvn_core.graph.matching import Matcher, Matches
from ltvn_core.graph.operators import OperatorThresholds, connectable, mergeable, node_with_edges
from ltvn_core.graph.planner import GraphPath, Planner
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.types import FrameId, NodeId


def expand(
    graph: TopologicalGraph,
    source: NodeId,
    goal: NodeId,
    matcher: Matcher,
    method: Method,
    rng: np.random.Generator,
) -> tuple[GraphDelta, ...]:
    """Return the deltas that join `source` to `goal` through images of the reserve; none if that fails."""
    if not graph.reserve or source not in graph.nodes or goal not in graph.nodes:
        return ()
    trial = graph.copy()
    planner = Planner(trial, method.planning)
    added: list[tuple[GraphDelta, ...]] = []
    for frame in _candidates(graph, source, goal, method, rng):
        deltas = _connecting_deltas(trial, frame, matcher, method)
        for delta in deltas:
            trial.apply(delta)
        added += [deltas] if deltas else []
        path = planner.plan(source, goal) if deltas else GraphPath((), np.inf)
        if path.nodes:
            return _restricted_to_path(path, added, graph)
    return ()


def reachable_nodes(graph: TopologicalGraph, start: NodeId, *, backwards: bool = False) -> set[NodeId]:
    """Return all nodes that can be reached from `start`, or that can reach it; it is one of them."""
    step = graph.predecessors if backwards else graph.successors
    seen, frontier = {start}, [start]
    while frontier:
        fresh = set(step(frontier.pop())) - seen
        seen |= fresh
        frontier.extend(fresh)
    return seen


def _candidates(
    graph: TopologicalGraph, source: NodeId, goal: NodeId, method: Method, rng: np.random.Generator
) -> list[FrameId]:
    """Order the reserve: at random, or those first that lie in time between what is reached and what is not."""
    frames = np.array(sorted(graph.reserve))
    limit = method.expanding.sample_limit
    if not limit:
        return [int(frame) for frame in rng.permutation(frames)]
    gap = _steps_to_nearest_node(frames, reachable_nodes(graph, source)) + _steps_to_nearest_node(
        frames, reachable_nodes(graph, goal, backwards=True)
    )
    return [int(frame) for frame in frames[np.argsort(gap, kind="stable")[:limit]]]


def _steps_to_nearest_node(frames: np.ndarray, nodes: set[NodeId]) -> np.ndarray:
    """Return (N,) steps from each frame to the node nearest in time."""
    ordered = np.array(sorted(nodes))
    after = np.searchsorted(ordered, frames)
    before = ordered[np.maximum(after - 1, 0)]
    return np.minimum(np.abs(frames - before), np.abs(frames - ordered[np.minimum(after, len(ordered) - 1)]))


def _connecting_deltas(
    trial: TopologicalGraph, frame: FrameId, matcher: Matcher, method: Method
) -> tuple[GraphDelta, ...]:
    """Return the deltas that make a frame a node of the trial map, none if it adds nothing or is not trusted."""
    nodes = _near_in_time(trial, frame, method.expanding.neighbour_limit)
    matches = matcher.match(matcher.keyframes.features([frame]), nodes)
    chosen = _connected(matches, frame, matcher, method)
    if not len(chosen):
        return ()
    seen = matcher.keyframes.observation(frame)
    released = FramesReleased((frame,), Cause.EXPAND)
    return released, *node_with_edges(seen, chosen, method.believing, Cause.EXPAND)


def _near_in_time(trial: TopologicalGraph, frame: FrameId, limit: int) -> Sequence[NodeId]:
    nodes = sorted(trial.nodes, key=lambda node: abs(node - frame))
    return nodes[:limit] if limit else nodes


def _connected(matches: Matches, frame: FrameId, matcher: Matcher, method: Method) -> Matches:
    thresholds = OperatorThresholds.building(method.building).for_novel_nodes(method.expanding)
    if not method.expanding.strict:
        merges = mergeable(matches, thresholds).any()
        return matches.take(connectable(matches, thresholds) & ~merges)
    # Merged images are welcome here: they are in the reserve because they look like a node, and so bridge gaps.
    chosen = LoopClosureVerifier(matcher).connections(frame, matches, thresholds)
    return chosen if len(chosen) >= 2 else chosen.take(np.zeros(len(chosen), bool))


def _restricted_to_path(
    path: GraphPath, added: Sequence[tuple[GraphDelta, ...]], graph: TopologicalGraph
) -> tuple[GraphDelta, ...]:
    """Keep new nodes on the path, and their edges to nodes that stay."""
    staying = set(path.nodes) | set(graph.nodes)
    return tuple(delta for deltas in added for delta in deltas if _is_kept(delta, staying))


def _is_kept(delta: GraphDelta, staying: set[NodeId]) -> bool:
    match delta:
        case FramesReleased():
            return delta.frames[0] in staying
        case NodeAdded():
            return delta.node.id in staying
        case EdgeAdded():
            return {delta.edge.source, delta.edge.target} <= staying
        case NodeDropped() | BeliefUpdated() | EdgePruned() | EdgeProtected() | NodeNamed() | FramesReserved():
            return True
        case PresenceObserved() | ViewAdded() | ViewUsed() | ViewDropped() | DriveBegun():
            return True
    assert_never(delta)
