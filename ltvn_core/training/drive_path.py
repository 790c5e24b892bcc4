"""Poses of the images of a drive, from ground truth or odometry, and the near and far pairs by these poses.

Obstacles between two images are ignored. Owns the limits of near and far pairs, and the drift up to which odometry is
trusted.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import radians

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.errors import RecordingError
from ltvn_core.geometry import relative
from ltvn_core.network.training_data.trajectory import odometry_jumps, odometry_steps
from ltvn_core.network.training_data.trajectory_pairs import OdometryLabelRule
from ltvn_core.types import Observation, Pose, Waypoint


@dataclass(frozen=True, slots=True)
class TruthLimits:
    """Limits of near and far pairs; a pair between the limits has no label."""

    near_m: float = 0.6
    """Largest distance of a near pair in metres; its target must lie in front of the source."""
    near_rad: float = radians(20)
    """Largest difference of heading of a near pair, in radians."""
    far_m: float = 1.5
    """Distance in metres above which a pair is far, whatever its difference of heading is."""
    far_rad: float = radians(60)
    """Difference of heading in radians above which a pair is far, whatever its distance is."""

    def near(self, moves: Waypoint) -> NDArray[np.bool_]:
        """Return which true moves (..., 3), as from `TrueViews.moves_to`, lead to a near target."""
        near = np.hypot(moves[..., 0], moves[..., 1]) < self.near_m
        return near & (np.abs(moves[..., 2]) < self.near_rad) & (moves[..., 0] > 0)

    def far(self, moves: Waypoint) -> NDArray[np.bool_]:
        """Return which true moves (..., 3) lead to a far target."""
        return (np.hypot(moves[..., 0], moves[..., 1]) > self.far_m) | (np.abs(moves[..., 2]) > self.far_rad)


LIMITS = TruthLimits()
"""Limits of near and far pairs in `ltvn judge`."""


@dataclass(frozen=True, slots=True, eq=False)
class TrueViews:
    """True poses of N images, and the orientations of their cameras."""

    poses: Pose
    """Poses (N, 3)."""
    rotations: NDArray[np.float64]
    """Rotations (N, 3, 3) from the axes of each camera (forward, left, up), including its tilt, to those of the
    world."""

    def __len__(self) -> int:
        return len(self.poses)

    def take(self, rows: NDArray[np.intp] | Sequence[int]) -> "TrueViews":
        """Return the chosen views."""
        return TrueViews(self.poses[rows], self.rotations[rows])

    def moves_to(self, targets: "TrueViews") -> Waypoint:
        """Return the moves (N, T, 3) to all targets: metres ahead, metres left, and rotation of the camera.

        The rotation is the angle in space, in radians and never negative: a hand-held camera that looks down instead of
        up has rotated, although its yaw is the same.
        """
        moves = relative(self.poses[:, None], targets.poses[None])
        # The trace of R_i^T R_j, for all pairs at once.
        traces = self.rotations.reshape(-1, 9) @ targets.rotations.reshape(-1, 9).T
        moves[..., 2] = np.arccos(np.clip((traces - 1) / 2, -1, 1))
        return moves

    def move(self, source: int, target: int) -> Waypoint:
        """Return the move (3,) from one image to another."""
        return self.take([source]).moves_to(self.take([target]))[0, 0]


def true_views(observations: Sequence[Observation], cameras: Sequence[CameraModel]) -> TrueViews:
    """Return the true views of images with true poses, each with its camera and tilt."""
    poses = np.array([seen.exact_pose for seen in observations], np.float64).reshape(-1, 3)
    return TrueViews(poses, camera_rotations(poses, cameras))


def camera_rotations(poses: Pose, cameras: Sequence[CameraModel]) -> NDArray[np.float64]:
    """Return the orientations (N, 3, 3) of cameras in the world, including their tilt, on robots at poses (N, 3)."""
    cos = np.cos(poses[:, 2])
    sin = np.sin(poses[:, 2])
    turned = np.zeros((len(poses), 3, 3))
    turned[:, 0, 0], turned[:, 0, 1] = cos, -sin
    turned[:, 1, 0], turned[:, 1, 1] = sin, cos
    turned[:, 2, 2] = 1
    tilted = np.array([replace(camera, quarter_turns=0).rotation for camera in cameras]).reshape(-1, 3, 3)
    return turned @ tilted


def tilted_camera(seen: Observation, camera: CameraModel) -> CameraModel:
    """Return a camera with the tilt that it had when it took an image."""
    if seen.tilt is None:
        return camera
    return replace(camera, pitch_rad=seen.tilt.pitch_rad, roll_rad=seen.tilt.roll_rad)


FEWEST_IMAGES = 20
_EXACT_M, _EXACT_RAD = 0.06, radians(4)
"""Largest possible drift, in metres and radians, up to which odometry can tell whether a pose is right."""
_RULE = OdometryLabelRule()


@dataclass(frozen=True, slots=True, eq=False)
class DrivePath:
    """Poses of N images of a drive, in order."""

    poses: Pose
    """Poses (N, 3)."""
    is_exact: bool
    """Whether the poses are ground truth; otherwise they are odometry, which drifts."""
    piece: NDArray[np.intp]
    """Number (N,) of each image's piece; jumps of the odometry separate the pieces."""
    travelled_m: NDArray[np.float64]
    """Distance (N,) driven so far, in metres."""
    turned_rad: NDArray[np.float64]
    """Rotation (N,) in either direction so far, in radians."""
    rotations: NDArray[np.float64]
    """Rotations (N, 3, 3) from the axes of each camera (forward, left, up), including its tilt, to those of the
    world."""

    def waypoints(self, source: NDArray[np.intp], target: NDArray[np.intp]) -> Waypoint:
        """Return the waypoints (P, 3) from sources (P,) to targets (P,); with odometry they include its drift."""
        return relative(self.poses[source], self.poses[target])

    def known(self, source: NDArray[np.intp], target: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Return which waypoints (P,) are known well enough to decide whether a pose is right."""
        if self.is_exact:
            return np.ones(len(source), bool)
        drift_m, drift_rad = self._drift(source, target)
        return (self.piece[source] == self.piece[target]) & (drift_m < _EXACT_M) & (drift_rad < _EXACT_RAD)

    def near(self, source: NDArray[np.intp], target: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Return which targets (P,) are certainly near and in front."""
        gap = self.waypoints(source, target)
        # A hand-held camera that looks down instead of up has rotated, although its yaw is the same.
        traces = (self.rotations[source] * self.rotations[target]).sum((1, 2))
        turned = np.arccos(np.clip((traces - 1) / 2, -1, 1))
        return LIMITS.near(np.column_stack([gap[:, :2], turned])) & self.known(source, target)

    def far(self, source: NDArray[np.intp], target: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Return which targets (P,) are certainly far."""
        gap = self.waypoints(source, target)
        drift_m, drift_rad = self._drift(source, target)
        away = np.hypot(gap[:, 0], gap[:, 1]) - drift_m > LIMITS.far_m
        return (self.piece[source] == self.piece[target]) & (away | (np.abs(gap[:, 2]) - drift_rad > LIMITS.far_rad))

    def _drift(
        self, source: NDArray[np.intp], target: NDArray[np.intp]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the largest possible drift of odometry between sources and targets, in metres (P,) and radians
        (P,)."""
        if self.is_exact:
            return np.zeros(len(source)), np.zeros(len(source))
        driven = np.abs(self.travelled_m[target] - self.travelled_m[source])
        turned = np.abs(self.turned_rad[target] - self.turned_rad[source])
        return _RULE.drift * driven, _RULE.drift_turn * turned


def drive_path(observations: Sequence[Observation], name: str, camera: CameraModel) -> DrivePath:
    """Return the poses of images: true poses if all images have one, otherwise odometry.

    Raises RecordingError if there are too few images or no poses.
    """
    if len(observations) < FEWEST_IMAGES:
        raise RecordingError(
            f"{name}: {len(observations)} images are too few to learn from; it needs {FEWEST_IMAGES}. Record or import "
            "a longer drive, or train on a larger part of it."
        )
    exact = [seen.exact_pose for seen in observations if seen.exact_pose is not None]
    is_exact = len(exact) == len(observations)
    poses = np.array(exact if is_exact else [seen.odometry for seen in observations], np.float64)
    if not np.isfinite(poses).all() or np.ptp(poses, axis=0).max() == 0:
        raise RecordingError(
            f"{name}: training needs poses of its {len(poses)} images from ground truth or odometry, but all poses "
            "are the same, or some are missing. Import the drive with its odometry or its poses."
        )
    driven, turned = odometry_steps(poses)
    jumped = np.zeros(len(driven), bool) if is_exact else odometry_jumps(poses)
    return DrivePath(
        poses=poses,
        is_exact=is_exact,
        piece=np.concatenate([[0], np.cumsum(jumped)]).astype(np.intp),
        travelled_m=np.concatenate([[0], np.cumsum(driven * ~jumped)]),
        turned_rad=np.concatenate([[0], np.cumsum(turned * ~jumped)]),
        rotations=camera_rotations(poses, [tilted_camera(seen, camera) for seen in observations]),
    )
