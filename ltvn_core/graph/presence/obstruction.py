"""An obstruction, and the edges whose ways it closes.

Owns the geometry: ways of edges as lines in the frame of one node, composed from nearby waypoints so that drift of
odometry does not matter. Detects nothing and decides nothing.
"""

import heapq
from collections.abc import Collection, Iterator, Sequence
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
"""Points farther than this from the line of an edge stand beside the robot's path."""
_MIDDLE_M = 0.07
"""Points nearer than this to the line stand in the middle of the way."""
_LEAST_IN_MIDDLE = 2
"""Minimum number of points in the middle of the way; fewer count as noise."""
_BARRIER_M = 0.35
"""Points within this distance before or behind an obstacle belong to the same barrier."""
_END_M = 0.2
"""An obstacle within this distance behind the end of a way leaves the robot no room to stand there, as a door behind
its sill."""
_SAME_THING_M = 0.3
"""Largest distance between points of one thing."""
_SHORTEST_M = 0.05
"""Shorter ways are turns on the spot."""
_NEARBY_D = 4.0
"""Nodes farther along the map than this d are ignored."""


@dataclass(frozen=True, slots=True, eq=False)
class Obstruction:
    """A solid obstacle that was not there when the map was made."""

    node: NodeId
    """The node in whose frame the points are."""
    points: FloatArray
    """(M, 2) points of the obstacle in metres, x forward and y left of the node."""
    known: FloatArray
    """(M', 2) other solid points around, which were always there."""
    stopped: bool
    """Whether it stopped the robot on the edge that it drove, whose source is the node."""

    def things(self) -> Iterator["Obstruction"]:
        """Yield each thing separately; the other new points then count as its surroundings."""
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
    """Return the edges whose ways the points lie across; linear in the edges nearby."""
    ways = ways_nearby(graph, obstruction.node)
    return tuple(key for key, way in ways.items() if closes_way(obstruction, *way))


def ways_nearby(graph: TopologicalGraph, node: NodeId) -> dict[EdgeKey, FloatArray]:
    """Return the straight ways of the edges around one node, each (2, 2): start and end, metres in its frame.

    An edge is around it where one of its ends is.
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
    """Tell whether obstacles leave the robot no room on the straight way from `start` (2,) to `end` (2,).

    One stands in the middle of the way with no room on either side, such as a door between its jambs.
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
    """Return (M,) metres from points (M, 2) to the straight way from `start` (2,) to `end` (2,)."""
    way = end - start
    share = np.clip((points - start) @ way / max(float(way @ way), 1e-9), 0.0, 1.0)
    return np.linalg.norm(points - start - share[:, None] * way, axis=1)


def nearby_poses(graph: TopologicalGraph, node: NodeId, *, without: Collection[EdgeKey] = ()) -> dict[NodeId, Pose]:
    """Return the poses (3,) of the nodes around one node, in its frame, along the shortest chains of waypoints.

    They are in order of the length of these chains. `without`: edges of which, in both directions, no chain is made.
    """
    left_out = {*without, *((target, source) for source, target in without)}
    found: dict[NodeId, Pose] = {}
    queue: list[tuple[float, NodeId, list[float]]] = [(0.0, node, [0.0, 0.0, 0.0])]
    while queue:
        length, here, place = heapq.heappop(queue)
        if here in found:
            continue
        found[here] = np.array(place)
        edges = [edge for edge in _edges_at(graph, here) if (edge.source, edge.target) not in left_out]
        onward = [
            (so_far, other, edge)
            for edge in edges
            if (other := edge.target if edge.source == here else edge.source) not in found
            and (so_far := length + edge.belief.mu) <= _NEARBY_D
        ]
        places = _beyond(found[here], [edge for *_, edge in onward], here)
        for (so_far, other, _), there in zip(onward, places, strict=True):
            heapq.heappush(queue, (so_far, other, there))
    return found


def _edges_at(graph: TopologicalGraph, node: NodeId) -> list[Edge]:
    keys = [(node, other) for other in graph.successors(node)] + [(other, node) for other in graph.predecessors(node)]
    edges = graph.edges
    return [edges[key] for key in keys]


def _beyond(pose: Pose, edges: Sequence[Edge], here: NodeId) -> list[list[float]]:
    """Return the poses (3,) of the other ends of edges, given the pose `here` (3,) of one end."""
    if not edges:
        return []
    steps = np.array([edge.waypoint for edge in edges])
    back = np.array([edge.source != here for edge in edges])
    steps[back] = invert(steps[back])
    return compose(pose, steps).tolist()
