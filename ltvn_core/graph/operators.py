"""The paper's two operators, isMergeable and isConnectable, and the deltas that tie an image into the map.

Owns the decisions about one image against the nodes; building, driving and maintenance all use these, with their own
thresholds. Changes no graph.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ltvn_core.config import BeliefConfig, BuildingConfig
from ltvn_core.geometry import invert
from ltvn_core.graph.deltas import Belief, Cause, Edge, EdgeAdded, GraphDelta, Node, NodeAdded, PoseRow
from ltvn_core.graph.matching import Matcher, Matches
from ltvn_core.types import FrameId, NodeId, Observation, Waypoint

_MERGE_CANDIDATES = 3
_MERGE_REACHABILITY = 0.6
"""Least r for merging; the paper has none."""
_NOVEL_CONNECT, _NOVEL_MERGE = 1.3, 0.6
"""Factors on D_c and D_m for novel nodes: the paper makes the first looser and the second smaller."""


@dataclass(frozen=True, slots=True)
class OperatorThresholds:
    """The thresholds of the two operators."""

    merge_distance: float
    """D_m: greatest d for merging."""
    connect_distance: float
    """D_c: greatest d for an edge."""
    connect_reachability: float
    """R_c: least r for an edge."""

    @classmethod
    def building(cls, config: BuildingConfig) -> "OperatorThresholds":
        """Return the thresholds of Algorithm 1."""
        return cls(config.merge_distance, config.connect_distance, config.connect_reachability)

    def for_novel_nodes(self) -> "OperatorThresholds":
        """Return the thresholds for novel nodes: D_c looser, D_m smaller."""
        return replace(
            self,
            merge_distance=self.merge_distance * _NOVEL_MERGE,
            connect_distance=self.connect_distance * _NOVEL_CONNECT,
        )


def mergeable(matches: Matches, thresholds: OperatorThresholds) -> NDArray[np.bool_]:
    """Tell for each node (N,) whether the image merges with it: d < D_m."""
    return (matches.distances < thresholds.merge_distance) & (matches.reachability > _MERGE_REACHABILITY)


def connectable(matches: Matches, thresholds: OperatorThresholds) -> NDArray[np.bool_]:
    """Tell for each node (N,) whether an edge may join it to the image: d < D_c and r > R_c."""
    return (matches.distances < thresholds.connect_distance) & (matches.reachability > thresholds.connect_reachability)


def nearest_mergeable(
    frame: FrameId, found: Matches, matcher: Matcher, thresholds: OperatorThresholds
) -> Matches | None:
    """Return the match of the node that a stored frame merges with, the nearest one; None if there is none."""
    alike = found.take(mergeable(found, thresholds))
    # One by one, because temporal support is expensive and the nearest node nearly always has it.
    for k in np.argsort(alike.distances, kind="stable")[:_MERGE_CANDIDATES]:
        nearest = matcher.with_mutual_support(alike.take(np.array([k])), frame)
        if mergeable(nearest, thresholds).any():
            return nearest
    return None


def initial_belief(reachability: float, distance: float, config: BeliefConfig) -> Belief:
    """Return the belief of a new edge: p0 = r capped, mu0 = d(w), sigma0^2 = sigma^2."""
    return Belief(min(float(reachability), config.p_cap), float(distance), config.sigma2)


def node_from_observation(observation: Observation) -> Node:
    """Return the node that an image becomes."""
    return Node(observation.step, pose_row(observation.odometry))


def pose_row(pose: Waypoint) -> PoseRow:
    """Return a pose (3,) as plain numbers."""
    return PoseRow(*(float(value) for value in pose))


def node_with_edges(
    observation: Observation, matches: Matches, config: BeliefConfig, cause: Cause, *, by_odometry: bool = False
) -> list[GraphDelta]:
    """Return the deltas that make an image a node and join it both ways to every match."""
    return [
        NodeAdded(node_from_observation(observation), cause),
        *bidirectional_edges(observation.step, matches, config, cause, by_odometry=by_odometry),
    ]


def bidirectional_edges(
    source: NodeId, matches: Matches, config: BeliefConfig, cause: Cause, *, by_odometry: bool = False
) -> Iterable[EdgeAdded]:
    """Yield an edge to each match and the reverse edge, whose waypoint is the inverse.

    `by_odometry` marks edges that only odometry supports.
    """
    for k, target in enumerate(matches.nodes):
        belief = initial_belief(matches.reachability[k], matches.distances[k], config)
        ahead = pose_row(matches.waypoints[k])
        back = pose_row(invert(matches.waypoints[k]))
        yield EdgeAdded(Edge(source, target, ahead, belief, by_odometry=by_odometry), cause)
        yield EdgeAdded(Edge(target, source, back, belief, by_odometry=by_odometry), cause)
