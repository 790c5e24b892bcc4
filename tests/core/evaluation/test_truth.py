"""A map is held against the simulator: edges through walls are spurious, however the map comes by them."""

from dataclasses import replace

import numpy as np
import pytest

from ltvn_core.errors import MapError
from ltvn_core.evaluation.ground_truth import GroundTruth, calibration_bins, floorplan, map_truth_metrics, shortest_m
from ltvn_core.graph.deltas import Cause, EdgePruned, NodeDropped
from ltvn_core.types import NodeId, Observation
from tests.core.evaluation.ground_truth_map import PLACES, exact_pose_of, map_with_edges, observation_of, truth
from tests.core.graph.small_maps import edge_added
from tests.core.simulation.fake_scene import BoxScene

THROUGH_THE_WALL = [(5, 6), (6, 5)]


def test_an_edge_through_a_wall_is_spurious_in_both_directions() -> None:
    graph = map_with_edges((1, 2), (2, 1), (2, 3), *THROUGH_THE_WALL)
    assert truth().spurious(graph) == set(THROUGH_THE_WALL)


@pytest.mark.parametrize("edge", [(1, 4), (3, 7)], ids=["too far", "turned too far"])
def test_an_edge_that_asks_too_much_is_spurious(edge: tuple[NodeId, NodeId]) -> None:
    assert truth().is_spurious(edge)


def test_a_turn_on_the_spot_is_not_spurious_however_far_it_is() -> None:
    assert not truth().is_spurious((4, 7))


def test_truth_follows_a_map_that_changes() -> None:
    graph, known = map_with_edges((1, 2), (5, 6)), truth()
    assert known.spurious(graph) == {(5, 6)}
    graph.apply(edge_added(6, 5))
    assert known.spurious(graph) == set(THROUGH_THE_WALL)
    graph.apply(EdgePruned(5, 6, Cause.HAND))
    assert known.spurious(graph) == {(6, 5)}
    assert known.is_spurious((5, 6))  # What was pruned can still be asked for.


def test_each_image_is_asked_for_once_and_held_when_the_map_has_dropped_it() -> None:
    asked: list[NodeId] = []

    def observation(node: NodeId) -> Observation:
        asked.append(node)
        return observation_of(node)

    graph, known = map_with_edges((1, 2), (2, 3)), GroundTruth(BoxScene().clearance, observation)
    known.spurious(graph)
    known.spurious(graph)
    graph.apply(NodeDropped(2, Cause.HAND))
    assert not known.is_spurious((1, 2))
    assert sorted(asked) == [1, 2, 3]


def test_a_map_from_outside_simulation_has_no_truth() -> None:
    known = GroundTruth(BoxScene().clearance, lambda node: replace(observation_of(node), exact_pose=None))
    with pytest.raises(MapError, match="node 1 has no exact pose"):
        known.spurious(map_with_edges((1, 2)))


@pytest.mark.parametrize(
    ("robot", "is_at"),
    [
        pytest.param((2.3, 0.8, 0.0), True, id="there"),
        pytest.param((2.3, 1.6, 0.9), True, id="near, turned a little"),
        pytest.param((2.3, 0.8, 1.2), False, id="turned away"),
        pytest.param((0.6, 0.8, 0.0), False, id="too far"),
        pytest.param((3.3, 0.8, 0.0), False, id="behind the wall"),
    ],
)
def test_a_robot_is_at_a_node_if_it_is_near_it_on_the_same_side(robot: tuple[float, ...], is_at: bool) -> None:
    assert truth().is_at(np.array(robot), 5) is is_at


def test_a_robot_is_beside_a_node_only_on_its_side_of_the_wall() -> None:
    known = truth()
    assert known.should_recognise_one(np.array([2.3, 2.5, 0.2]), PLACES)
    assert not known.should_recognise_one(np.array([2.6, 2.9, 0.0]), PLACES)
    beyond = np.array([3.1, 0.8, 0.0])
    assert known.should_recognise_one(beyond, [5, 6])
    assert not known.should_recognise_one(beyond, [5])
    assert not known.should_recognise_one(beyond, [])


def test_the_shortest_way_goes_around_the_wall() -> None:
    clearance = BoxScene().clearance
    assert shortest_m(clearance, exact_pose_of(1), exact_pose_of(2)) == pytest.approx(1.2)
    assert 2.4 < shortest_m(clearance, exact_pose_of(5), exact_pose_of(6)) < 3.6
    assert shortest_m(clearance, exact_pose_of(5), exact_pose_of(6)) == pytest.approx(
        shortest_m(clearance, exact_pose_of(6), exact_pose_of(5)), rel=0.03
    )


def test_a_map_is_counted_with_the_goals_that_it_leads_to() -> None:
    graph = map_with_edges((1, 2), (2, 1), (2, 3), (3, 4), *THROUGH_THE_WALL)
    facts = map_truth_metrics(graph, truth(), goals=(4, 1, 7, 99))
    assert (facts.nodes, facts.edges, facts.spurious_edges) == (7, 6, 2)
    assert facts.pieces == 5
    assert facts.goals_connected == 1  # 4 is reached from 1, 2 and 3; 7 from nowhere, and 99 is not there.
    # Of 1, 7 and 99 the map says that it does not hold them, and that is so.
    assert (facts.goals_told, facts.goals_told_rightly, facts.goals_untold) == (3, 3, 0)


def test_a_goal_behind_a_spurious_edge_is_one_that_nobody_was_told_of() -> None:
    edges = [(5, 6), (6, 5)]
    facts = map_truth_metrics(map_with_edges(*edges, nodes=(5, 6)), truth(), goals=(5, 6))
    assert (facts.goals_connected, facts.goals_told, facts.goals_untold) == (2, 0, 2)
    doubted = map_truth_metrics(map_with_edges(*edges, nodes=(5, 6), p=0.3), truth(), goals=(5, 6))
    assert (doubted.goals_told, doubted.goals_told_rightly, doubted.goals_untold) == (2, 2, 0)


def test_calibration_compares_belief_with_truth() -> None:
    graph = map_with_edges((1, 2), (2, 3), (3, 4), (5, 6), p=0.92)
    graph.apply(edge_added(6, 5, p=0.15))
    low, high = calibration_bins(graph, truth())
    assert (low.edges, low.mean_p, low.drivable) == (1, pytest.approx(0.15), 0.0)
    assert (high.low, high.high) == pytest.approx((0.9, 1.0))
    assert (high.edges, high.mean_p, high.drivable) == (4, pytest.approx(0.92), 0.75)


def test_a_map_without_edges_has_no_calibration() -> None:
    assert calibration_bins(map_with_edges(), truth()) == ()
    assert map_truth_metrics(map_with_edges(nodes=()), truth(), goals=()).nodes == 0


def test_a_floorplan_has_the_walls_and_marks_spurious_edges() -> None:
    plan = floorplan(map_with_edges((1, 2), (5, 6), p=0.7), truth())

    def cell(x: float, y: float) -> str:
        column, row = ((np.array([x, y]) - plan.origin) / plan.resolution_m).astype(int)
        return plan.free[row][column]

    assert (cell(2.0, 2.3), cell(2.85, 0.8), cell(2.85, 2.3)) == (".", "#", ".")
    assert dict((node, tuple(pose)) for node, *pose in plan.nodes) == PLACES
    assert plan.edges == ((1, 2, 0.7, False), (5, 6, 0.7, True))
