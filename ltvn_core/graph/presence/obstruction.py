"""An obstruction, and the edges that it closes.

Owns the geometry: paths of edges as lines in the frame of one node, composed from nearby waypoints so that drift of
odometry does not matter. The navigator detects obstructions and decides about them.
"""

import heapq
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from ltvn_core.geometry import compose, invert
from ltvn_core.graph.deltas import Edge
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.types import NodeId, Pose

FloatArray = NDArray[np.float64]

BODY_M = 0.2
"""Half the width of the robot's path, in metres; points farther from the line of an edge are beside it."""
_MIDDLE_M = 0.07
"""Half the width of the middle of a path, in metres."""
_LEAST_IN_MIDDLE = 2
"""Least number of obstacle points in the middle of a path; fewer count as noise."""
_BARRIER_M = 0.35
"""Largest distance, along the path, of points that belong to the same barrier, in metres."""
_END_M = 0.2
"""Largest distance behind the end of a path, in metres, of an obstacle that leaves the robot no room there, such as a
door behind its sill."""
_SAME_THING_M = 0.3
"""Largest distance between neighbouring points of one thing, in metres."""
_SHORTEST_M = 0.05
"""Least length of a path in metres; shorter ones are turns on the spot."""
_NEARBY_D = 4.0
"""Largest d of nearby nodes, along the map."""


@dataclass(frozen=True, slots=True, eq=False)
class Obstruction:
    """A solid obstacle that was not there when the map was made."""

    node: NodeId
    """The node in whose frame the points are."""
    points: FloatArray
    """(M, 2) points of the obstacle in metres, x forward and y left of the node."""
    known: FloatArray
    """(M', 2) other obstacle points nearby, which were always there."""
    stopped: bool
    """Whether it stopped the robot on the driven edge, whose source is `node`."""

    def things(self) -> Iterator["Obstruction"]:
        """Yield each thing separately; the points of the other things are added to its `known` points."""
        if not len(self.points):
            return
        pairs = KDTree(self.points).query_pairs(_SAME_THING_M, output_type="ndarray")
        count = len(self.points)
        joined = coo_array((np.ones(len(pairs), np.bool_), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
        things, of_thing = connected_components(joined, directed=False)
        for thing in range(things):
            own = of_thing == thing
            yield replace(self, points=self.points[own], known=np.concatenate([self.known, self.points[~own]]))


def edges_obstructed(graph: TopologicalGraph, obstruction: Obstruction) -> tuple[EdgeKey, ...]:
    """Return the edges whose paths the obstruction closes; linear in the number of nearby edges."""
    ways = ways_nearby(graph, obstruction.node)
    return tuple(key for key, way in ways.items() if closes_way(obstruction, *way))


def ways_nearby(graph: TopologicalGraph, node: NodeId) -> dict[EdgeKey, FloatArray]:
    """Return the straight paths of the edges near a node, each (2, 2): start and end, in metres in its frame.

    An edge is near if one of its ends is.
    """
    poses = nearby_poses(graph, node)
    edges = {(edge.source, edge.target): edge for around in poses for edge in _edges_at(graph, around)}
    if not edges:
        return {}
    waypoints = np.array([edge.waypoint for edge in edges.values()])
    near = [poses.get(source, poses.get(target)) for source, target in edges]
    steps = np.where([[source in poses] for source, _ in edges], 0.0, invert(waypoints))
    starts = compose(np.array(near), steps)
    return dict(zip(edges, np.stack([starts, compose(starts, waypoints)], axis=1)[..., :2], strict=True))


def closes_way(obstruction: Obstruction, start: FloatArray, end: FloatArray) -> bool:
    """Return whether obstacles leave the robot no room on the straight path from `start` (2,) to `end` (2,).

    That is so if an obstacle is in the middle of the path without room on either side, like a closed door in its frame.
    """
    way = end - start
    length = float(np.hypot(way[0], way[1]))
    if length < _SHORTEST_M:
        return False
    turn = np.array([[way[0], -way[1]], [way[1], way[0]]]) / length
    new, known = (points @ turn for points in (obstruction.points - start, obstruction.known - start))
    within = (new[:, 0] >= 0) & (new[:, 0] <= length + _END_M)
    middle = new[within & (np.abs(new[:, 1]) < _MIDDLE_M)]
    if len(middle) < _LEAST_IN_MIDDLE:
        return False
    solid = np.concatenate([new, known])
    beside = solid[np.abs(solid[:, 0] - np.median(middle[:, 0])) < _BARRIER_M, 1]
    return all(((aside > _MIDDLE_M) & (aside < BODY_M)).any() for aside in (beside, -beside))


def distances_to_way(points: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    """Return the distances (M,) in metres of points (M, 2) from the straight path from `start` (2,) to `end` (2,)."""
    way = end - start
    share = np.clip((points - start) @ way / max(float(way @ way), 1e-9), 0.0, 1.0)
    return np.linalg.norm(points - start - share[:, None] * way, axis=1)


def nearby_poses(graph: TopologicalGraph, node: NodeId) -> dict[NodeId, Pose]:
    """Return the poses (3,) of the nodes near a node, in its frame, along the shortest chains of waypoints.

    The nodes are ordered by the length of their chains.
    """
    found: dict[NodeId, Pose] = {}
    queue: list[tuple[float, NodeId, list[float]]] = [(0.0, node, [0.0, 0.0, 0.0])]
    while queue:
        length, here, place = heapq.heappop(queue)
        if here in found:
            continue
        found[here] = np.array(place)
        onward = [
            (so_far, other, edge)
            for edge in _edges_at(graph, here)
            if (other := edge.target if edge.source == here else edge.source) not in found
            and (so_far := length + edge.belief.mu) <= _NEARBY_D
        ]
        if not onward:
            continue
        steps = np.array([edge.waypoint for *_, edge in onward])
        back = np.array([edge.source != here for *_, edge in onward])
        steps[back] = invert(steps[back])
        for (so_far, other, _), there in zip(onward, compose(found[here], steps).tolist(), strict=True):
            heapq.heappush(queue, (so_far, other, there))
    return found


def _edges_at(graph: TopologicalGraph, node: NodeId) -> list[Edge]:
    """Return the driven edges from and to a node; edges with an action do not show where places are."""
    keys = [(node, other) for other in graph.successors(node)] + [(other, node) for other in graph.predecessors(node)]
    edges = graph.edges
    return [edge for key in keys if not (edge := edges[key]).action]
