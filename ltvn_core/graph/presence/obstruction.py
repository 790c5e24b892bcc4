"""What stands in the way of an edge, and which other edges it stands in the way of.

Owns the geometry: ways of edges as lines in the frame of one node, put together from waypoints nearby, so that drift of
odometry does not matter. Sees nothing and decides nothing.
"""

import heapq
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ltvn_core.geometry import compose, invert
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.types import NodeId, Pose

FloatArray = NDArray[np.float64]

BESIDE_M = 0.12
"""What is farther than this from the line of an edge stands beside its way."""
LEAST_POINTS = 4
"""Fewer points across a way are held to be noise."""
_NEARBY_D = 4.0
"""Nodes farther along the map than this d are not asked about."""


@dataclass(frozen=True, slots=True, eq=False)
class Obstruction:
    """Solid points that were not there when the map was made and lie across the way of an edge."""

    node: NodeId
    """The node in whose frame the points are."""
    points: FloatArray
    """(M, 2) metres, x forward and y left of the node."""


def edges_obstructed(graph: TopologicalGraph, obstruction: Obstruction) -> tuple[EdgeKey, ...]:
    """Return the edges whose ways the points lie across; linear in the edges nearby."""
    poses = nearby_poses(graph, obstruction.node)
    keys = [(node, target) for node in poses for target in graph.successors(node)]
    return tuple(
        key
        for key in keys
        if is_across(
            obstruction.points, poses[key[0]][:2], compose(poses[key[0]], np.array(graph.edges[key].waypoint))[:2]
        )
    )


def is_across(points: FloatArray, start: FloatArray, end: FloatArray, beside_m: float = BESIDE_M) -> bool:
    """Tell whether points (M, 2) lie across the straight way from `start` (2,) to `end` (2,)."""
    return int((distances_to_way(points, start, end) <= beside_m).sum()) >= LEAST_POINTS


def distances_to_way(points: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    """Return (M,) metres from points (M, 2) to the straight way from `start` (2,) to `end` (2,)."""
    way = end - start
    share = np.clip((points - start) @ way / max(float(way @ way), 1e-9), 0.0, 1.0)
    return np.linalg.norm(points - start - share[:, None] * way, axis=1)


def nearby_poses(graph: TopologicalGraph, node: NodeId) -> dict[NodeId, Pose]:
    """Return the poses (3,) of the nodes around one node, in its frame, along the surest chains of waypoints."""
    found: dict[NodeId, Pose] = {}
    queue: list[tuple[float, NodeId, tuple[float, ...]]] = [(0.0, node, (0.0, 0.0, 0.0))]
    while queue:
        length, here, place = heapq.heappop(queue)
        if here in found:
            continue
        pose = found[here] = np.array(place)
        for key in _edges_at(graph, here):
            other = key[1] if key[0] == here else key[0]
            edge = graph.edges[key]
            so_far = length + edge.belief.mu
            if other not in found and so_far <= _NEARBY_D:
                waypoint = np.array(edge.waypoint)
                step = waypoint if key[0] == here else invert(waypoint)
                heapq.heappush(queue, (so_far, other, tuple(map(float, compose(pose, step)))))
    return found


def _edges_at(graph: TopologicalGraph, node: NodeId) -> list[EdgeKey]:
    return [(node, other) for other in graph.successors(node)] + [(other, node) for other in graph.predecessors(node)]
