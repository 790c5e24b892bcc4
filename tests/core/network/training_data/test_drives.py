"""Drives look like a mapping tour, and their pairs are divided into near, far and neither."""

import numpy as np

from ltvn_core.geometry import wrap_angle
from ltvn_core.network.training_data.pose_sampling import classify_near_far, sample_drive_poses
from tests.core.network.training_data.box_world import two_rooms

WORLD = two_rooms()


def test_a_drive_moves_in_small_steps_over_free_floor() -> None:
    poses = sample_drive_poses(WORLD.floor, np.random.default_rng(1), 300)
    assert poses.shape == (300, 3)
    assert WORLD.floor.at(poses[:, :2]).min() > 0.1
    assert np.hypot(*np.diff(poses[:, :2], axis=0).T).max() < 0.25
    assert np.quantile(np.abs(wrap_angle(np.diff(poses[:, 2]))), 0.9) < 0.2


def test_near_needs_a_free_line_ahead_and_far_is_distance_turn_or_wall() -> None:
    poses = np.array([[3, 1.5, 0], [3.5, 1.5, 0], [4.6, 0.5, 0], [3.1, 1.5, np.pi], [0.4, 0.4, 0.2], [3.0, 2.3, 0]])
    near, far = classify_near_far(poses, WORLD.floor)
    assert near[0].tolist() == [False, True, False, False, False, False]
    assert far[0].tolist() == [False, False, True, True, False, False]
    assert not near[1, 0]  # It lies behind.
