"""The nodes of a map in one plane, in which places are compared and followed.

Owns how odometry and edges place the nodes; `graph.place_belief` follows the robot there.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree
from scipy.spatial import KDTree

from ltvn_core.geometry import agree, compose, invert, relative, wrap_angle
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.types import NodeId, Pose, Waypoint

SAME_POSE = (0.5, 0.35)
"""Two estimates of where a node is agree if they differ by less than this, in m and rad."""
_CONTINUES = (0.7, 0.7)
"""Odometry is unbroken along an edge that contradicts it by less than this, in m and rad: in bare corridors, waypoints
are wrong by as much as the odometry gate lets pass."""
_FAR_M = 1e4
"""Distance between parts that no edge joins, large enough that no node of one is near the other, in metres."""

_M_PER_RAD = 0.6
"""Metres that a radian counts as in the distance of two poses."""

Rows = NDArray[np.intp]


def apart(waypoint: Waypoint) -> NDArray[np.float64]:
    """Return the lengths (...) in metres of waypoints (..., 3); turns are converted to metres."""
    return np.hypot(waypoint[..., 0], waypoint[..., 1]) + _M_PER_RAD * np.abs(wrap_angle(waypoint[..., 2]))


@dataclass(frozen=True, slots=True, eq=False)
class NodeLayout:
    """N nodes in one plane."""

    nodes: tuple[NodeId, ...]
    poses: Pose
    """(N, 3) poses of the nodes in that plane."""
    row_of: Mapping[NodeId, int]
    tree: KDTree
    """Tree of the (N, 2) places of the nodes."""


def lay_out(graph: TopologicalGraph) -> NodeLayout:
    """Return the poses of a map's nodes in one plane."""
    nodes = tuple(graph.nodes)
    poses = np.array([graph.nodes[node].odometry for node in nodes]).reshape(-1, 3)
    row_of = {node: row for row, node in enumerate(nodes)}
    driven = graph.driven_edges
    edges = np.array([(row_of[source], row_of[target]) for source, target in driven], np.intp).reshape(-1, 2)
    waypoints = np.array([edge.waypoint for edge in driven.values()]).reshape(-1, 3)
    by_odometry = relative(poses[edges[:, 0]], poses[edges[:, 1]])
    # Odometry that never moves fits short edges, but says nothing.
    fit = agree(by_odometry, waypoints, _CONTINUES) & by_odometry.any(axis=1)
    joined = coo_array((np.ones(fit.sum()), (edges[fit, 0], edges[fit, 1])), shape=(len(nodes), len(nodes)))
    part_of = np.asarray(connected_components(joined, directed=False)[1], np.intp)
    between = part_of[edges[:, 0]] != part_of[edges[:, 1]]
    frames = _frames(poses, part_of, edges[between], waypoints[between])
    placed = compose(frames[part_of], poses)
    return NodeLayout(nodes, placed, row_of, KDTree(placed[:, :2]))


def _frames(poses: Pose, part_of: Rows, edges: Rows, waypoints: Waypoint) -> Pose:
    """Return the origins (P, 3) of the parts' frames in the common plane."""
    count = int(part_of.max(initial=-1)) + 1
    back = part_of[edges[:, 0]] > part_of[edges[:, 1]]
    edges = np.where(back[:, None], edges[:, ::-1], edges)
    waypoints = np.where(back[:, None], invert(waypoints), waypoints)
    pairs, which = np.unique(part_of[edges], axis=0, return_inverse=True)
    found = [_joint(poses, edges[rows], waypoints[rows]) for rows in which.ravel() == np.arange(len(pairs))[:, None]]
    joints = {(first, second): joint for (first, second), (joint, _) in zip(pairs.tolist(), found, strict=True)}
    unsure = np.array([1 / agreeing for _, agreeing in found], np.float64)
    tree = minimum_spanning_tree(coo_array((unsure, (pairs[:, 0], pairs[:, 1])), shape=(count, count)).tocsr())
    frames = np.zeros((count, 3))
    placed = np.zeros(count, bool)
    for rank, root in enumerate(np.argsort(-np.bincount(part_of, minlength=count), kind="stable").tolist()):
        if placed[root]:
            continue
        frames[root, 0] = _FAR_M * rank
        order, before = breadth_first_order(tree, root, directed=False)
        placed[order] = True
        for part in order[1:].tolist():
            from_ = int(before[part])
            joint = joints[from_, part] if (from_, part) in joints else invert(joints[part, from_])
            frames[part] = compose(frames[from_], joint)
    return frames


def _joint(poses: Pose, edges: Rows, waypoints: Waypoint) -> tuple[Pose, int]:
    """Return the frame (3,) of a second part in that of a first, from the edge that most other edges agree with, and
    the number of edges that agree.

    Edges lie far from the origins of the frames, so they are compared at their ends.
    """
    seen = compose(poses[edges[:, 0]], waypoints)
    frames = compose(seen, invert(poses[edges[:, 1]]))
    count = agree(compose(frames[:, None], poses[edges[:, 1]][None]), seen[None], SAME_POSE).sum(axis=1)
    best = int(np.argmax(count))
    return frames[best], int(count[best])
