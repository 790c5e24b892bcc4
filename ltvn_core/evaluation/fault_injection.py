"""Injects faults into a correct map, to test the debugger: spurious edges, perceptual aliases and missing edges.

The ground truth determines their places. A fault is a list of graph deltas together with a query that meets it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, maximum_flow

from ltvn_core.config import BeliefConfig
from ltvn_core.errors import MapError
from ltvn_core.evaluation.ground_truth import GroundTruth
from ltvn_core.geometry import distance, invert, relative
from ltvn_core.graph.beliefs import initial_belief
from ltvn_core.graph.deltas import Cause, Edge, EdgeAdded, EdgePruned, GraphDelta
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.operators import pose_row
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.types import NodeId, Pose, Predictor, Waypoint

THROUGH_WALL_M = 2.5
"""Greatest length of a spurious edge, in metres; such an edge is spurious only because of the wall."""
DETOUR_M = 3.5
"""Least length of the true path around the wall, in metres."""
ALIAS_DISTANCE_M = 3.0
"""Least distance between two places that are perceptual aliases, in metres."""
_APART_M = 1.0
"""Least distance between several spurious edges, in metres, so that they do not all lead through one wall."""
_ENDPOINT_MARGIN_M = 2.0
"""Distance that a cut keeps from the start and goal of the query."""
_BATCH = 4096


class FaultKind(StrEnum):
    """The kind of a fault; its value is stored in recordings."""

    SPURIOUS_EDGE = "spurious-edge"
    """An edge through a wall with a high p."""
    PERCEPTUAL_ALIAS = "look-alike"
    """An edge between two distant places that the network predicts to be close."""
    MISSING_EDGE = "missing-edge"
    """No edge where there was a passage, so that the map is in two parts."""


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault and a query that meets it."""

    kind: FaultKind
    edges: tuple[EdgeKey, ...]
    """Edges that are added or removed."""
    deltas: tuple[GraphDelta, ...]
    """Deltas that inject the fault."""
    start: NodeId
    """Node at which the robot starts."""
    goal: NodeId


def missing_edge(graph: TopologicalGraph, truth: GroundTruth) -> Fault:
    """Remove the minimum cut between the two nodes that are farthest apart, as if a passage was never mapped.

    Raises MapError if every cut is too close to the start or the goal.
    """
    nodes = list(graph.nodes)
    places = truth.poses(nodes)[:, :2]
    start = int(np.hypot(*(places - places.mean(axis=0)).T).argmax())
    goal = int(np.hypot(*(places - places[start]).T).argmax())
    side = _start_side_of_cut(graph, nodes, places, start, goal)
    edges = tuple(key for key in graph.edges if (key[0] in side) != (key[1] in side))
    if not edges or any({nodes[start], nodes[goal]} & set(key) for key in edges):
        raise MapError("This map has no passage that could be cut; choose a larger one.")
    cuts = tuple(EdgePruned(*key, Cause.LOAD) for key in edges)
    return Fault(kind=FaultKind.MISSING_EDGE, edges=edges, deltas=cuts, start=nodes[start], goal=nodes[goal])


def spurious_edge(
    graph: TopologicalGraph, truth: GroundTruth, config: BeliefConfig, *, detour_m: float = DETOUR_M
) -> Fault:
    """Connect two nodes with similar headings and a wall between them: the pair with the longest true path.

    Both nodes are in one component of the map. Raises MapError if no true path is longer than `detour_m`.
    """
    return spurious_edges(graph, truth, config, 1, detour_m=detour_m)[0]


def spurious_edges(
    graph: TopologicalGraph, truth: GroundTruth, config: BeliefConfig, count: int, *, detour_m: float = DETOUR_M
) -> tuple[Fault, ...]:
    """Connect pairs of nodes as `spurious_edge` does, at different places, starting with the longest true path.

    Raises MapError if there are fewer than `count` such pairs.
    """
    nodes = list(graph.nodes)
    poses = truth.poses(nodes)
    pairs = sorted(_hidden_pairs(truth, poses, _components(graph), detour_m), key=lambda pair: -pair[2])
    faults: list[Fault] = []
    ends: list[int] = []
    for row, other, _ in pairs:
        apart = np.linalg.norm(poses[ends][:, None, :2] - poses[[row, other]][None, :, :2], axis=-1)
        if len(faults) < count and (apart > _APART_M).all():
            ends += [row, other]
            waypoint = relative(poses[row], poses[other])
            kind = FaultKind.SPURIOUS_EDGE
            faults.append(_fault_of_edge(kind, nodes[row], nodes[other], waypoint, config.p_cap, config))
    if len(faults) < count:
        raise MapError(
            f"This map has {len(faults)} distant pairs of nodes with a wall between them and a long route around it, "
            f"but {count} are needed; choose another map or fewer edges."
        )
    return tuple(faults)


def _hidden_pairs(
    truth: GroundTruth, poses: Pose, pieces: NDArray[np.intp], detour_m: float
) -> Iterator[tuple[int, int, float]]:
    """Yield two rows of `poses` (N, 3) with a wall between them, and the length of the true path if it exceeds
    `detour_m`."""
    for row, pose in enumerate(poses):
        ahead = _is_ahead(relative(pose, poses))
        hidden = ahead & (truth.clearance.along(np.broadcast_to(pose[:2], (len(poses), 2)), poses[:, :2]) <= 0)
        rows = np.flatnonzero(hidden & (pieces == pieces[row]))
        ways_m = truth.clearance.path_lengths(pose, poses[rows, :2])
        for other, way_m in zip(rows.tolist(), ways_m.tolist(), strict=True):
            if np.isfinite(way_m) and way_m > detour_m:
                yield row, other, way_m


def perceptual_alias(
    graph: TopologicalGraph,
    truth: GroundTruth,
    keyframes: KeyframeStore,
    predictor: Predictor,
    config: BeliefConfig,
    near: float,
) -> Fault:
    """Connect the two distant nodes, in one component of the map, with the highest predicted r and d < `near`.

    Compares all pairs; 327 nodes take ten seconds. Raises MapError if there is no such pair.
    """
    nodes = list(graph.nodes)
    poses = truth.poses(nodes)
    features = keyframes.features(nodes)
    first, second = _far_pairs(poses, _components(graph))
    best = None
    surest = 0.0
    for begin in range(0, len(first), _BATCH):
        i = first[begin : begin + _BATCH]
        j = second[begin : begin + _BATCH]
        predicted = predictor.predict(features[i], features[j])
        candidate = (distance(predicted.waypoints) < near) & (predicted.waypoints[:, 0] > 0)
        score = np.where(candidate, predicted.reachability, 0.0)
        top = int(score.argmax())
        if score[top] > surest:
            best = (int(i[top]), int(j[top]), predicted.waypoints[top])
            surest = float(score[top])
    if best is None:
        raise MapError("The network finds no perceptual aliases in this map; choose another map or other weights.")
    return _fault_of_edge(FaultKind.PERCEPTUAL_ALIAS, nodes[best[0]], nodes[best[1]], best[2], surest, config)


def _fault_of_edge(
    kind: FaultKind, source: NodeId, target: NodeId, waypoint: Waypoint, p: float, config: BeliefConfig
) -> Fault:
    belief = initial_belief(p, float(distance(waypoint)), config)
    there = Edge(source=source, target=target, waypoint=pose_row(waypoint), belief=belief)
    back = Edge(source=target, target=source, waypoint=pose_row(invert(waypoint)), belief=belief)
    deltas = EdgeAdded(there, Cause.LOAD), EdgeAdded(back, Cause.LOAD)
    return Fault(kind=kind, edges=((source, target), (target, source)), deltas=deltas, start=source, goal=target)


def _is_ahead(waypoints: Waypoint) -> NDArray[np.bool_]:
    """Return which targets (N, 3) are ahead, close, and have a similar heading."""
    dx, dy, dtheta = waypoints.T
    return (dx > 0.5) & (np.hypot(dx, dy) < THROUGH_WALL_M) & (np.abs(dy) < dx) & (np.abs(dtheta) < 1.0)


def _components(graph: TopologicalGraph) -> NDArray[np.intp]:
    """Return the component of the map (N,) of each node; a fault between two components would hide a missing edge."""
    row = {node: k for k, node in enumerate(graph.nodes)}
    ends = np.array([(row[source], row[target]) for source, target in graph.edges], np.intp).reshape(-1, 2)
    joined = csr_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), (len(row), len(row)))
    return connected_components(joined, directed=False)[1]


def _far_pairs(poses: Pose, pieces: NDArray[np.intp]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    gaps = poses[:, None, :2] - poses[None, :, :2]
    far = (np.hypot(gaps[..., 0], gaps[..., 1]) > ALIAS_DISTANCE_M) & (pieces[:, None] == pieces[None, :])
    first, second = np.nonzero(far)
    return first, second


def _start_side_of_cut(
    graph: TopologicalGraph, nodes: Sequence[NodeId], places: NDArray[np.float64], start: int, goal: int
) -> set[NodeId]:
    """Return the nodes on the start's side of the minimum cut that keeps a distance from start and goal."""
    row = {node: k for k, node in enumerate(nodes)}
    both_ways = {*graph.edges, *((target, source) for source, target in graph.edges)}
    ends = np.array([(row[source], row[target]) for source, target in both_ways], np.intp).reshape(-1, 2)
    close = np.minimum(*(np.hypot(*(places - places[k]).T) for k in (start, goal))) < _ENDPOINT_MARGIN_M
    # Edges near start and goal are too expensive to cut.
    room = np.where(close[ends].any(axis=1), len(ends), 1).astype(np.int32)
    capacity = csr_array((room, (ends[:, 0], ends[:, 1])), (len(nodes), len(nodes)))
    left = capacity - maximum_flow(capacity, start, goal).flow
    left.data = np.maximum(left.data, 0)
    left.eliminate_zeros()
    reached = breadth_first_order(left, start, return_predecessors=False)
    return {nodes[k] for k in reached.tolist()}
