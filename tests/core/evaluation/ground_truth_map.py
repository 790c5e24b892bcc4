"""A map in a house of two rooms whose poses are known, for tests of the truth. Owns no assertion."""

import numpy as np

from ltvn_core.evaluation.ground_truth import GroundTruth
from ltvn_core.graph.deltas import Cause
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.types import NodeId, Observation, Pose
from tests.core.flat_world import observation_at
from tests.core.graph.small_maps import edge_added, node_added
from tests.core.simulation.fake_scene import BoxScene

PLACES: dict[NodeId, tuple[float, float, float]] = {
    1: (0.8, 2.3, 0.0),
    2: (2.0, 2.3, 0.0),
    3: (3.6, 2.3, 0.0),  # Through the opening from 2.
    4: (5.0, 2.3, 0.0),
    5: (2.3, 0.8, 0.0),  # The wall at x = 2.8 to 2.9 is between 5 and 6.
    6: (3.4, 0.8, 0.0),
    7: (5.0, 2.3, 2.5),  # At 4, and turned.
}
"""Exact poses of all images."""


def exact_pose_of(node: NodeId) -> Pose:
    """Return the exact pose of an image, (3,)."""
    return np.array(PLACES[node], np.float64)


def observation_of(node: NodeId) -> Observation:
    """Return an image."""
    return observation_at(exact_pose_of(node), node)


def truth() -> GroundTruth:
    """Return what is true, with nothing asked yet."""
    return GroundTruth(BoxScene().clearance, observation_of)


def map_with_edges(*edges: EdgeKey, p: float = 0.9, nodes: tuple[NodeId, ...] = tuple(PLACES)) -> TopologicalGraph:
    """Return a map of all places with these edges."""
    added = (edge_added(*edge, p=p, sigma2=0.1, cause=Cause.LOAD) for edge in edges)
    return TopologicalGraph([*(node_added(node, cause=Cause.LOAD) for node in nodes), *added])
