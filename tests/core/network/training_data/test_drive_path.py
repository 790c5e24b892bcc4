"""What the poses of a drive tell of two of its images, and what they do not because odometry drifts."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.errors import RecordingError
from ltvn_core.geometry import wrap_angle
from ltvn_core.network.training_data.pose_sampling import classify_near_far, sample_drive_poses
from ltvn_core.training.drive_path import drive_path
from ltvn_core.types import Observation, Pose, Tilt
from tests.core.network.training_data.box_world import two_rooms

CAMERA = CameraModel.from_fov(4, 3, 1.0)
LINE: Pose = np.array([[0.1 * k, 0.0, 0.0] for k in range(60)])


def images(odometry: Pose, exact: Pose | None = None) -> list[Observation]:
    blank = np.zeros((3, 4, 3), np.uint8)
    seen = [
        Observation(rgb=blank, depth=None, odometry=pose, stamp=float(k), step=k) for k, pose in enumerate(odometry)
    ]
    return seen if exact is None else [replace(each, exact_pose=exact[each.step]) for each in seen]


def rows(*pairs: tuple[int, int]) -> Sequence[np.ndarray]:
    return [np.array(column, np.intp) for column in zip(*pairs, strict=True)]


def test_true_poses_tell_of_all_pairs() -> None:
    path = drive_path(images(LINE * 0, LINE), "drive", CAMERA)
    assert path.is_exact
    source, target = rows((0, 4), (4, 0), (0, 7), (0, 59))
    assert path.known(source, target).all()
    assert path.near(source, target).tolist() == [True, False, False, False]
    assert path.far(source, target).tolist() == [False, False, False, True]


def test_a_camera_in_the_hand_that_looks_down_has_turned() -> None:
    seen = images(LINE, LINE)
    seen[4] = replace(seen[4], tilt=Tilt(pitch_rad=-0.6, roll_rad=0.0))
    path = drive_path(seen, "drive", CAMERA)
    assert path.near(*rows((0, 3), (0, 4))).tolist() == [True, False]


def test_odometry_tells_of_pairs_over_which_it_cannot_have_drifted_much() -> None:
    path = drive_path(images(LINE), "drive", CAMERA)
    assert not path.is_exact
    source, target = rows((0, 4), (0, 40), (0, 15))
    assert path.known(source, target).tolist() == [True, False, False]
    assert path.near(source, target).tolist() == [True, False, False]
    assert path.far(source, target).tolist() == [False, True, False]


def test_nothing_is_known_across_a_jump_of_odometry() -> None:
    jumping = LINE.copy()
    jumping[30:, 0] -= 2.0
    path = drive_path(images(jumping), "drive", CAMERA)
    source, target = rows((10, 32), (29, 30), (10, 59))
    assert not (path.known(source, target) | path.far(source, target)).any()


def test_a_drive_without_poses_or_with_few_images_is_refused() -> None:
    with pytest.raises(RecordingError, match="odometry"):
        drive_path(images(LINE * 0), "drive", CAMERA)
    with pytest.raises(RecordingError, match="5 images are too few"):
        drive_path(images(LINE[:5]), "drive", CAMERA)


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
