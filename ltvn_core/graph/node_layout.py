"""The nodes of a map in one plane, although parts of it may have unrelated odometry frames.

Owns how these parts are put together: by the edges that join them. Poses are as exact as odometry within a part.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree

from ltvn_core.geometry import agree, compose, invert, relative
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.types import NodeId, Pose, Waypoint

SAME_POSE = (0.5, 0.35)
"""Two estimates of where a node is agree if they differ by less than this, in m and rad."""
_FAR_M = 1e4
"""Distance between parts that no edge joins, large enough that no node of one is near the other, in metres."""

Rows = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class NodeLayout:
    """N nodes in one plane."""

    nodes: tuple[NodeId, ...]
    poses: Pose
    """(N, 3) poses of the nodes in that plane."""


def lay_out(graph: TopologicalGraph) -> NodeLayout:
    """Return the poses of a map's nodes in one plane."""
    nodes = tuple(graph.nodes)
    poses = np.array([graph.nodes[node].odometry for node in nodes]).reshape(-1, 3)
    row_of = {node: row for row, node in enumerate(nodes)}
    driven = graph.driven_edges
    edges = np.array([(row_of[source], row_of[target]) for source, target in driven], np.intp).reshape(-1, 2)
    waypoints = np.array([edge.waypoint for edge in driven.values()]).reshape(-1, 3)
    fit = agree(relative(poses[edges[:, 0]], poses[edges[:, 1]]), waypoints, SAME_POSE)
    part_of = _components(len(nodes), edges[fit])
    between = part_of[edges[:, 0]] != part_of[edges[:, 1]]
    frames = _frames(poses, part_of, edges[between], waypoints[between])
    return NodeLayout(nodes, compose(frames[part_of], poses))


def _frames(poses: Pose, part_of: Rows, edges: Rows, waypoints: Waypoint) -> Pose:
    """Return the origins (P, 3) of the parts' frames in the common plane."""
    count = int(part_of.max(initial=-1)) + 1
    joints = dict[tuple[int, int], Pose]()
    agreeing = dict[tuple[int, int], int]()
    back = part_of[edges[:, 0]] > part_of[edges[:, 1]]
    edges = np.where(back[:, None], edges[:, ::-1], edges)
    waypoints = np.where(back[:, None], invert(waypoints), waypoints)
    pairs, which = np.unique(part_of[edges], axis=0, return_inverse=True)
    for k, (first, second) in enumerate(pairs.tolist()):
        rows = which.ravel() == k
        joints[first, second], agreeing[first, second] = _joint(poses, edges[rows], waypoints[rows])
    ends = np.array(list(joints), np.intp).reshape(-1, 2)
    unsure = 1 / np.array(list(agreeing.values()), np.float64)
    tree = minimum_spanning_tree(coo_array((unsure, (ends[:, 0], ends[:, 1])), shape=(count, count)).tocsr())
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


def _components(count: int, edges: Rows) -> Rows:
    joined = coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(count, count))
    return np.asarray(connected_components(joined, directed=False)[1], np.intp)
