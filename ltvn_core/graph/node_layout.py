"""Node layout: where the nodes of a map lie in one plane, for who must know what is near though no edge leads there.

Images of one drive share its odometry, those of two drives or of a later query do not. So odometry is believed along
the edges that agree with it; the parts that it joins so are laid against each other by the edges between them, of which
the one counts that most others agree with. Owns that layout. It is right over short ways; nothing is planned on it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree

from ltvn_core.geometry import compose, invert, relative, wrap_angle
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.types import NodeId, Pose, Waypoint

_GAP_M, _GAP_RAD = 0.5, 0.4
"""Two ways to know where a node is agree if they differ by no more."""
_FAR_M = 1e4
"""Parts that no edge joins lie so far apart, where nothing of the one is near the other."""

Rows = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class NodeLayout:
    """N nodes in one plane."""

    nodes: tuple[NodeId, ...]
    poses: Pose
    """(N, 3)."""


def lay_out(graph: TopologicalGraph) -> NodeLayout:
    """Return where the nodes of a map lie."""
    nodes = tuple(graph.nodes)
    poses = np.array([graph.nodes[node].odometry for node in nodes]).reshape(-1, 3)
    row_of = {node: row for row, node in enumerate(nodes)}
    edges = np.array([(row_of[source], row_of[target]) for source, target in graph.edges], np.intp).reshape(-1, 2)
    waypoints = np.array([edge.waypoint for edge in graph.edges.values()]).reshape(-1, 3)
    agree = _near(relative(poses[edges[:, 0]], poses[edges[:, 1]]), waypoints)
    part_of = _components(len(nodes), edges[agree])
    between = part_of[edges[:, 0]] != part_of[edges[:, 1]]
    frames = _frames(poses, part_of, edges[between], waypoints[between])
    return NodeLayout(nodes, compose(frames[part_of], poses))


def _frames(poses: Pose, part_of: Rows, edges: Rows, waypoints: Waypoint) -> Pose:
    """Return (P, 3) where the frames of the parts lie."""
    count = int(part_of.max(initial=-1)) + 1
    joints, agreeing = dict[tuple[int, int], Pose](), dict[tuple[int, int], int]()
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
    frames, placed = np.zeros((count, 3)), np.zeros(count, bool)
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
    """Return the frame (3,) of a second part in that of a first, by the edge that most edges agree with, and how many.

    Edges lie far from where a frame begins, so they are compared where they end.
    """
    seen = compose(poses[edges[:, 0]], waypoints)
    frames = compose(seen, invert(poses[edges[:, 1]]))
    agree = _near(compose(frames[:, None], poses[edges[:, 1]][None]), seen[None]).sum(axis=1)
    best = int(np.argmax(agree))
    return frames[best], int(agree[best])


def _components(count: int, edges: Rows) -> Rows:
    joined = coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(count, count))
    return np.asarray(connected_components(joined, directed=False)[1], np.intp)


def _near(first: Pose, second: Pose) -> NDArray[np.bool_]:
    gap = relative(first, second)
    return (np.hypot(gap[..., 0], gap[..., 1]) < _GAP_M) & (np.abs(wrap_angle(gap[..., 2])) < _GAP_RAD)
