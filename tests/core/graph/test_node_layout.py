"""Where nodes lie whose images have odometry of their own each, or none that can be believed."""

import numpy as np
import pytest

from ltvn_core.geometry import compose, relative
from ltvn_core.graph.deltas import Belief, Cause, Edge, EdgeAdded, NodeAdded
from ltvn_core.graph.node_layout import lay_out
from ltvn_core.graph.operators import node_from_observation, pose_row
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.types import Pose
from tests.core.flat_world import observation_at

PLACES = np.array([[0.8 * k, 0.1 * k, 0.2 * k] for k in range(8)])
ELSEWHERE = np.array([50.0, -20.0, 2.0])


def graph_of(odometry: Pose, edges: list[tuple[int, int]], places: Pose = PLACES) -> TopologicalGraph:
    """Return a map of places (8, 3) whose images have this odometry (8, 3); the edges know where nodes are."""
    graph = TopologicalGraph()
    for frame, measured in enumerate(odometry):
        graph.apply(NodeAdded(node_from_observation(observation_at(places[frame], frame, measured)), Cause.BUILD))
    for source, target in edges:
        way = pose_row(relative(places[source], places[target]))
        graph.apply(EdgeAdded(Edge(source, target, way, Belief(0.9, 0.8, 0.02)), Cause.BUILD))
    return graph


IN_A_ROW = [(k, k + 1) for k in range(7)]


@pytest.mark.parametrize(
    ("odometry", "places"),
    [
        (PLACES, PLACES),
        (np.concatenate([PLACES[:5], compose(ELSEWHERE, PLACES[5:])]), PLACES),
        (np.zeros((8, 3)), PLACES),
        (np.zeros((8, 3)), PLACES / 2),
    ],
    ids=["one drive", "two drives", "no odometry", "no odometry, short edges"],
)
def test_nodes_lie_to_each_other_as_they_are(odometry: Pose, places: Pose) -> None:
    layout = lay_out(graph_of(odometry, IN_A_ROW, places))
    assert layout.nodes == tuple(range(8))
    assert np.allclose(relative(layout.poses[0], layout.poses), relative(places[0], places), atol=1e-6)


def test_one_false_edge_between_two_drives_is_outvoted() -> None:
    odometry = np.concatenate([PLACES[:4], compose(ELSEWHERE, PLACES[4:])])
    graph = graph_of(odometry, [*IN_A_ROW, (2, 4), (3, 5)])
    false = Edge(0, 7, pose_row(np.array([0.3, 0.0, 0.0])), Belief(0.9, 0.3, 0.02))
    graph.apply(EdgeAdded(false, Cause.BUILD))
    layout = lay_out(graph)
    assert np.allclose(relative(layout.poses[0], layout.poses), relative(PLACES[0], PLACES), atol=1e-6)


def test_waypoints_that_are_too_short_in_a_bare_corridor_do_not_shift_what_lies_beyond() -> None:
    graph = graph_of(PLACES, [edge for edge in IN_A_ROW if edge != (3, 4)])
    way = relative(PLACES[3], PLACES[4]) - (0.6, 0.0, 0.0)
    graph.apply(EdgeAdded(Edge(3, 4, pose_row(way), Belief(0.9, 0.2, 0.02)), Cause.BUILD))
    layout = lay_out(graph)
    assert np.allclose(relative(layout.poses[0], layout.poses), relative(PLACES[0], PLACES), atol=1e-6)


def test_parts_that_no_edge_joins_are_not_near_each_other() -> None:
    layout = lay_out(graph_of(PLACES, [(k, k + 1) for k in range(7) if k != 3]))
    apart = np.hypot(*(layout.poses[:4, None, :2] - layout.poses[None, 4:, :2]).reshape(-1, 2).T)
    assert apart.min() > 1000


def test_a_map_without_nodes_has_no_layout() -> None:
    assert lay_out(TopologicalGraph()).nodes == ()
