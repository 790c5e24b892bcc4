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


def test_a_target_a_metre_ahead_in_the_same_room_is_reachable() -> None:
    found = label_pair([1, 2, 0], [2, 2.1, 0.1])
    assert found.reachable[0]
    assert found.failed[0] == FailedCriteria.NOTHING


@pytest.mark.parametrize(
    ("source", "target", "failed"),
    [
        ([3.4, 1.5, 0], [4.6, 1.5, 0], FailedCriteria.VISIBILITY | FailedCriteria.LINE),
        ([2, 2, 0], [1, 2, 0], FailedCriteria.VISIBILITY),
        ([2, 2, 0], [2.1, 2, np.pi], FailedCriteria.YAW),
        ([0.6, 2, 0], [3.4, 2, 0], FailedCriteria.DISTANCE),
        ([1, 2, 0], [2, 2, np.radians(70)], FailedCriteria.YAW),
        ([2, 1, -np.pi / 2], [2, 0.1, -np.pi / 2], FailedCriteria.LINE),
        ([3.6, 2.2, 0.9], [4.4, 2.2, 0.0], FailedCriteria.NOTHING),
    ],
    ids=["behind a wall", "behind", "looking back", "too far", "turned too far", "near a wall", "round the corner"],
)
def test_a_target_that_breaks_a_criterion_is_not_reachable(
    source: list[float], target: list[float], failed: FailedCriteria
) -> None:
    found = label_pair(source, target)
    assert not found.reachable[0]
    assert failed in FailedCriteria(int(found.failed[0]))


def test_a_small_step_back_is_reachable_because_the_robot_stands_there_already() -> None:
    assert label_pair([2, 2, 0], [1.85, 2, 0]).reachable[0]


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
