"""Labels follow the paper's criteria in a hand-made world of two rooms."""

import numpy as np
import pytest

from ltvn_core.geometry import relative
from ltvn_core.network.training_data.reachability_labels import (
    FailedCriteria,
    PairLabels,
    label_poses,
    overlap,
    path_ratio,
)
from ltvn_core.network.training_data.shards import render_poses
from ltvn_core.robots.robot_spec import LOCOBOT
from tests.core.network.training_data.box_world import two_rooms

WORLD = two_rooms()


def label_pair(source: list[float], target: list[float]) -> PairLabels:
    poses = np.array([source, target], float)
    _, depth_mm = render_poses(WORLD.camera, poses)
    depth = depth_mm / np.float32(1000)
    return label_poses(poses[:1], poses[1:], depth[:1], depth[1:], WORLD.floor)


def failures(source: list[float], target: list[float]) -> FailedCriteria:
    return FailedCriteria(int(label_pair(source, target).failed[0]))


def test_a_target_a_metre_ahead_in_the_same_room_is_reachable() -> None:
    found = label_pair([1, 2, 0], [2, 2.1, 0.1])
    assert found.reachable[0]
    assert found.failed[0] == FailedCriteria.NOTHING
    np.testing.assert_allclose(found.waypoints[0], [1, 0.1, 0.1])


def test_a_target_behind_a_wall_is_not_reachable() -> None:
    assert FailedCriteria.VISIBILITY in failures([3.4, 1.5, 0], [4.6, 1.5, 0])
    assert FailedCriteria.LINE in failures([3.4, 1.5, 0], [4.6, 1.5, 0])


def test_a_target_round_the_corner_is_not_reachable() -> None:
    assert failures([3.6, 2.2, 0.9], [4.4, 2.2, 0.0]) != FailedCriteria.NOTHING


def test_a_target_behind_the_robot_is_not_reachable() -> None:
    assert FailedCriteria.VISIBILITY in failures([2, 2, 0], [1, 2, 0])


def test_the_same_place_looking_back_is_not_reachable() -> None:
    assert FailedCriteria.YAW in failures([2, 2, 0], [2.1, 2, np.pi])


def test_a_target_too_far_or_turned_too_much_is_not_reachable() -> None:
    assert FailedCriteria.DISTANCE in failures([0.6, 2, 0], [3.4, 2, 0])
    assert FailedCriteria.YAW in failures([1, 2, 0], [2, 2, np.radians(70)])


def test_a_small_step_back_is_reachable_because_the_robot_stands_there_already() -> None:
    assert label_pair([2, 2, 0], [1.85, 2, 0]).reachable[0]


def test_a_target_too_near_to_a_wall_is_not_reachable() -> None:
    assert FailedCriteria.LINE in failures([2, 1, -np.pi / 2], [2, 0.1, -np.pi / 2])


def test_overlap_is_the_share_of_the_targets_points_that_the_source_sees() -> None:
    poses = np.array([[0.5, 2, 0], [2.5, 2, 0]])  # Driving ahead narrows the view.
    _, depth_mm = render_poses(WORLD.camera, poses)
    depth, camera = depth_mm / np.float32(1000), LOCOBOT.camera
    ahead = overlap(relative(poses[:1], poses[1:]), depth[:1], depth[1:], camera)[0]
    back = overlap(relative(poses[1:], poses[:1]), depth[1:], depth[:1], camera)[0]
    assert ahead > 0.9
    assert back < 0.6


def test_overlap_is_full_with_itself_and_empty_when_turned_away() -> None:
    poses = np.array([[2, 2, 0], [2, 2, np.pi]])
    _, depth_mm = render_poses(WORLD.camera, poses)
    depth, camera = depth_mm / np.float32(1000), LOCOBOT.camera
    assert overlap(np.zeros((1, 3)), depth[:1], depth[:1], camera)[0] == pytest.approx(1)
    assert overlap(relative(poses[:1], poses[1:]), depth[:1], depth[1:], camera)[0] == 0


def test_the_path_ratio_is_one_on_a_free_line_and_large_around_a_wall() -> None:
    poses = np.array([[3.4, 1.5, 0], [2, 1.5, 0], [4.6, 1.5, 0]])
    ratio = path_ratio(poses[[0, 0]], poses[[1, 2]], WORLD.floor, limit=10)
    assert ratio[0] == pytest.approx(1)
    assert ratio[1] > 2


def test_overlap_and_path_are_only_measured_where_the_cheap_criteria_hold() -> None:
    found = label_pair([0.6, 2, 0], [3.4, 2, 0])
    assert np.isnan(found.overlap[0])
    assert np.isnan(found.path_ratio[0])


def test_missing_depth_does_not_hide_a_target_and_counts_no_overlap() -> None:
    poses = np.array([[1, 2, 0], [2, 2, 0]], float)
    blind = np.zeros((1, 72, 96), np.float32)
    found = label_poses(poses[:1], poses[1:], blind, blind, WORLD.floor)
    assert FailedCriteria(int(found.failed[0])) == FailedCriteria.OVERLAP
    assert found.overlap[0] == 0
