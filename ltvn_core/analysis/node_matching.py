"""Which node of one map is which node of another.

Owns the two ways to tell: the same image where both maps come from one trajectory, else the nearest place.
"""

from collections.abc import Mapping
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from ltvn_core.geometry import distance, relative
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.types import NodeId, Pose

MAX_MATCH_DISTANCE = 0.75
"""Nodes farther apart than this d of Eq. 2 are never the same: half a metre and 20 degrees (ours)."""


class MatchedBy(StrEnum):
    """How the nodes of two maps were told to be the same."""

    ID = "id"
    """Both maps come from one trajectory, and a node is named after its image."""
    POSE = "pose"
    """They come from two trajectories, and the nearest poses belong together."""


class NodeMatching(NamedTuple):
    """Which nodes are the same."""

    matched_by: MatchedBy
    pairs: Mapping[NodeId, NodeId]
    """Node of the first map to node of the second; none occurs twice."""


def match_nodes(
    a: TopologicalGraph,
    b: TopologicalGraph,
    *,
    poses_a: Mapping[NodeId, Pose] | None = None,
    poses_b: Mapping[NodeId, Pose] | None = None,
) -> NodeMatching:
    """Match nodes by id if the maps come from one trajectory, else each to its nearest if that is mutual.

    Poses (3,) are those given, for instance exact ones in simulation; else odometry's, which compares only if both
    drives began at one place. Takes O(N log N).
    """
    shared = [node for node in a.nodes if node in b.nodes and a.nodes[node].odometry == b.nodes[node].odometry]
    if len(shared) * 2 >= min(len(a.nodes), len(b.nodes)):
        return NodeMatching(MatchedBy.ID, {node: node for node in shared})
    return NodeMatching(MatchedBy.POSE, _nearest(_node_poses(a, poses_a), _node_poses(b, poses_b)))


def _node_poses(graph: TopologicalGraph, poses: Mapping[NodeId, Pose] | None = None) -> dict[NodeId, Pose]:
    """Return a pose (3,) for each node: the given one, else odometry's."""
    given = poses or {}
    return {node: given.get(node, np.array(value.odometry, np.float64)) for node, value in graph.nodes.items()}


def _nearest(a: Mapping[NodeId, Pose], b: Mapping[NodeId, Pose]) -> dict[NodeId, NodeId]:
    if not a or not b:
        return {}
    names, others = list(a), list(b)
    first, second = np.array(list(a.values())), np.array(list(b.values()))
    to_second = np.asarray(KDTree(_embedded(second)).query(_embedded(first))[1])
    to_first = np.asarray(KDTree(_embedded(first)).query(_embedded(second))[1])
    mutual = np.flatnonzero(to_first[to_second] == np.arange(len(names)))
    near = mutual[distance(relative(first[mutual], second[to_second[mutual]])) <= MAX_MATCH_DISTANCE]
    return {names[k]: others[int(to_second[k])] for k in near.tolist()}


def _embedded(poses: Pose) -> np.ndarray:
    """Lay poses (N, 3) into (N, 4) so that plain distance is close to d for small turns."""
    turn = np.sqrt(2) * np.stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])], axis=1)
    return np.concatenate([poses[:, :2], turn], axis=1)
