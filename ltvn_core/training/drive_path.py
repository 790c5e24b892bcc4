"""Where the images of a drive were taken, by true poses or by odometry, and what is therefore known of two of them.

Owns how far odometry may drift before it says nothing any more.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import radians

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.errors import RecordingError
from ltvn_core.geometry import relative
from ltvn_core.training_data.trajectory import KeyframeSelection, odometry_jumps, odometry_steps
from ltvn_core.training_data.trajectory_pairs import OdometryLabelRule
from ltvn_core.training_data.truth_limits import LIMITS, camera_rotations, tilted_camera
from ltvn_core.types import Observation, Pose, Waypoint

FEWEST_IMAGES = 20
_EXACT_M, _EXACT_RAD = 0.06, radians(4)
"""Odometry that may have drifted by less than this tells whether a pose is right."""
_RULE = OdometryLabelRule()
_SELECTION = KeyframeSelection()


@dataclass(frozen=True, slots=True, eq=False)
class DrivePath:
    """Where N images were taken, in order."""

    poses: Pose
    """(N, 3)"""
    is_exact: bool
    """They are true poses; else odometry, which drifts."""
    piece: NDArray[np.intp]
    """(N,) number of the piece between jumps of the odometry."""
    travelled_m: NDArray[np.float64]
    """(N,) metres driven so far,"""
    turned_rad: NDArray[np.float64]
    """(N,) and radians turned, to either side."""
    rotations: NDArray[np.float64]
    """(N, 3, 3): from the camera's (forward, left, up) to the world's, its tilt included."""

    def waypoints(self, source: NDArray[np.intp], target: NDArray[np.intp]) -> Waypoint:
        """Return where targets (P,) are as seen from sources (P,), (P, 3), drift included."""
        return relative(self.poses[source], self.poses[target])

    def known(self, source: NDArray[np.intp], target: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Tell whether a waypoint between them is known well enough to judge a pose by, (P,)."""
        if self.is_exact:
            return np.ones(len(source), bool)
        drift_m, drift_rad = self._drift(source, target)
        return (self.piece[source] == self.piece[target]) & (drift_m < _EXACT_M) & (drift_rad < _EXACT_RAD)

    def near(self, source: NDArray[np.intp], target: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Tell which targets are certainly near and in front, (P,)."""
        gap = self.waypoints(source, target)
        # A camera in the hand that looks down instead of up has turned, although its yaw is the same.
        traces = (self.rotations[source] * self.rotations[target]).sum((1, 2))
        turned = np.arccos(np.clip((traces - 1) / 2, -1, 1))
        return LIMITS.near(np.column_stack([gap[:, :2], turned])) & self.known(source, target)

    def far(self, source: NDArray[np.intp], target: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Tell which targets are certainly far, (P,)."""
        gap = self.waypoints(source, target)
        drift_m, drift_rad = self._drift(source, target)
        away = np.hypot(gap[:, 0], gap[:, 1]) - drift_m > LIMITS.far_m
        return (self.piece[source] == self.piece[target]) & (away | (np.abs(gap[:, 2]) - drift_rad > LIMITS.far_rad))

    def _drift(
        self, source: NDArray[np.intp], target: NDArray[np.intp]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return by how many metres (P,) and radians (P,) odometry may have drifted in between."""
        if self.is_exact:
            return np.zeros(len(source)), np.zeros(len(source))
        driven = np.abs(self.travelled_m[target] - self.travelled_m[source])
        turned = np.abs(self.turned_rad[target] - self.turned_rad[source])
        return _RULE.drift * driven, _RULE.drift_turn * turned


def drive_path(observations: Sequence[Observation], name: str, camera: CameraModel) -> DrivePath:
    """Return where a camera took images: by their true poses if all have one, else by odometry.

    Raises RecordingError where there are too few images, or nobody knows.
    """
    if len(observations) < FEWEST_IMAGES:
        raise RecordingError(
            f"{name}: {len(observations)} images are too few to learn from; it takes {FEWEST_IMAGES}. Record or import "
            "a longer drive, or learn from a larger part of it."
        )
    exact = [seen.exact_pose for seen in observations if seen.exact_pose is not None]
    is_exact = len(exact) == len(observations)
    poses = np.array(exact if is_exact else [seen.odometry for seen in observations], np.float64)
    if not np.isfinite(poses).all() or np.ptp(poses, axis=0).max() == 0:
        raise RecordingError(
            f"{name}: learning takes the poses of its {len(poses)} images from ground truth or odometry, and there is "
            "neither: all of them are the same, or some are missing. Import the drive with its odometry or its poses."
        )
    driven, turned = odometry_steps(poses)
    jumped = np.zeros(len(driven), bool) if is_exact else odometry_jumps(poses, _SELECTION)
    return DrivePath(
        poses=poses,
        is_exact=is_exact,
        piece=np.concatenate([[0], np.cumsum(jumped)]).astype(np.intp),
        travelled_m=np.concatenate([[0], np.cumsum(driven * ~jumped)]),
        turned_rad=np.concatenate([[0], np.cumsum(turned * ~jumped)]),
        rotations=camera_rotations(poses, [tilted_camera(seen, camera) for seen in observations]),
    )
