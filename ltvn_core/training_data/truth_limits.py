"""Which pairs of images are near and which are far, by true poses. What stands between them does not count."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import radians

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.geometry import relative
from ltvn_core.types import Observation, Pose, Waypoint


@dataclass(frozen=True, slots=True)
class TruthLimits:
    """Limits of near and far pairs; a pair between them has no label."""

    near_m: float = 0.6
    """The target of a near pair lies nearer than this, in front of the source,"""
    near_rad: float = radians(20)
    """and is turned by less than this."""
    far_m: float = 1.5
    """The target of a far pair lies farther away than this,"""
    far_rad: float = radians(60)
    """or is turned by more than this."""

    def near(self, moves: Waypoint) -> NDArray[np.bool_]:
        """Tell which true moves (..., 3), see `TrueViews.moves_to`, lead to a near target."""
        near = np.hypot(moves[..., 0], moves[..., 1]) < self.near_m
        return near & (np.abs(moves[..., 2]) < self.near_rad) & (moves[..., 0] > 0)

    def far(self, moves: Waypoint) -> NDArray[np.bool_]:
        """Tell which true moves (..., 3) lead to a far target."""
        return (np.hypot(moves[..., 0], moves[..., 1]) > self.far_m) | (np.abs(moves[..., 2]) > self.far_rad)


LIMITS = TruthLimits()
"""What `ltvn judge` calls near and far."""


@dataclass(frozen=True, slots=True, eq=False)
class TrueViews:
    """Where N images were truly taken, and where their camera looked."""

    poses: Pose
    """(N, 3)."""
    rotations: NDArray[np.float64]
    """(N, 3, 3): from the camera's (forward, left, up) to the world's, its tilt included."""

    def __len__(self) -> int:
        return len(self.poses)

    def take(self, rows: NDArray[np.intp] | Sequence[int]) -> "TrueViews":
        """Return the chosen ones."""
        return TrueViews(self.poses[rows], self.rotations[rows])

    def moves_to(self, targets: "TrueViews") -> Waypoint:
        """Return the moves (N, T, 3) to all targets: metres ahead, metres left, and by how much the camera turns.

        The turn, in radians and never negative, is that of the camera in space: a camera in the hand that looks down
        instead of up has turned, although its yaw is the same.
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
    """Return the true views of images that have a true pose, each with the camera that took it, tilt included."""
    poses = np.array([seen.exact_pose for seen in observations], np.float64).reshape(-1, 3)
    return TrueViews(poses, camera_rotations(poses, cameras))


def camera_rotations(poses: Pose, cameras: Sequence[CameraModel]) -> NDArray[np.float64]:
    """Return how cameras were turned in the world (N, 3, 3), tilt included, by robots at poses (N, 3)."""
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    turned = np.zeros((len(poses), 3, 3))
    turned[:, 0, 0], turned[:, 0, 1] = cos, -sin
    turned[:, 1, 0], turned[:, 1, 1] = sin, cos
    turned[:, 2, 2] = 1
    tilted = np.array([replace(camera, quarter_turns=0).rotation for camera in cameras]).reshape(-1, 3, 3)
    return turned @ tilted


def tilted_camera(seen: Observation, camera: CameraModel) -> CameraModel:
    """Return a camera as it was tilted when it took an image."""
    if seen.tilt is None:
        return camera
    return replace(camera, pitch_rad=seen.tilt.pitch_rad, roll_rad=seen.tilt.roll_rad)
