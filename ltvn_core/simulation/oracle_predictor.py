"""The truth in the network's clothes: a `Predictor` that answers from exact poses and the clearance map.

Owns the geometric reading of the paper's reachability criteria, and the ground truth by which evaluation calls an edge
spurious. Separates errors of the network from errors of the method; never used on a real robot.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ltvn_core.config import Likelihoods
from ltvn_core.geometry import relative
from ltvn_core.simulation.clearance_map import ClearanceMap
from ltvn_core.types import Features, Intrinsics, Observation, Pose, Prediction, Waypoint

REACHABLE = 0.97
UNREACHABLE = 0.03
"""What the oracle answers; never quite sure, because beliefs of 0 and 1 could not be revised."""

LIKELIHOODS = Likelihoods(0.98, 0.02, 1e-4)
"""Constants of Eq. 3 and Eq. 4 for a method that asks the oracle.

Exact waypoints lead to their ends, and an exact r denies an end that was not reached. None is a certainty, and sigma is
a centimetre, because a map that learns nothing could not be tested.
"""

MAX_DISTANCE_M = 2.5
"""E_max of the paper's criteria; the value is ours."""
MAX_YAW_RAD = float(np.deg2rad(60))
"""Theta_max of the paper's criteria; the value is ours."""
VIEW_NOT_NEEDED_M = 0.25
"""A target nearer than this need not be in view."""
MIN_CLEARANCE_M = 0.18
"""Room that the robot's centre needs on the straight line."""

SPURIOUS_DISTANCE_M = 2.8
SPURIOUS_YAW_RAD = 1.6
SPURIOUS_CLEARANCE_M = 0.15
"""An edge is called spurious with some tolerance: the map of clearance is a grid and the robot slides along walls."""


class OraclePredictor:
    """Knows the scene. Implements `ltvn_core.types.Predictor`; its features are the exact poses, (N, 3)."""

    fingerprint = "oracle"

    def __init__(self, clearance: ClearanceMap, intrinsics: Intrinsics | None = None) -> None:
        self._clearance = clearance
        self._half_fov_rad = (intrinsics or Intrinsics()).horizontal_fov_rad / 2

    def encode(self, observations: Sequence[Observation]) -> Features:
        """Return the exact poses (N, 3) of the observations.

        Raises ValueError when one has none, as outside simulation.
        """
        poses = [observation.exact_pose for observation in observations]
        for observation, pose in zip(observations, poses, strict=True):
            if pose is None:
                raise ValueError(
                    f"The oracle needs the exact pose of each image, and image {observation.step} has none; it was "
                    "not taken in simulation. Use the network's predictor."
                )
        return np.array(poses, np.float64).reshape(-1, 3)

    def predict(self, sources: Features, targets: Features) -> Prediction:
        """Compare exact poses (N, 3) or (1, 3) with (N, 3): exact waypoints, reachability 0.97 or 0.03."""
        starts, ends = np.broadcast_arrays(np.asarray(sources, np.float64), np.asarray(targets, np.float64))
        waypoints = relative(starts, ends)
        reachable = self._is_visible(waypoints)
        reachable[reachable] &= is_line_free(self._clearance, starts[reachable], ends[reachable], MIN_CLEARANCE_M)
        return Prediction(np.where(reachable, REACHABLE, UNREACHABLE), waypoints)

    def _is_visible(self, waypoints: Waypoint) -> NDArray[np.bool_]:
        dx, dy, dtheta = np.moveaxis(waypoints, -1, 0)
        distance_m = np.hypot(dx, dy)
        in_view = (dx > 0) & (np.abs(np.arctan2(dy, dx)) < self._half_fov_rad)
        near = (distance_m < MAX_DISTANCE_M) & (np.abs(dtheta) < MAX_YAW_RAD)
        return near & (in_view | (distance_m < VIEW_NOT_NEEDED_M))


def is_line_free(
    clearance: ClearanceMap, starts: Pose, ends: Pose, min_clearance_m: float = SPURIOUS_CLEARANCE_M
) -> NDArray[np.bool_]:
    """Say for N pairs of poses (N, 3) whether the straight line between them leaves room for the robot, (N,)."""
    if len(starts) == 0:
        return np.zeros(0, bool)
    return np.asarray(clearance.along(starts[:, :2], ends[:, :2])) > min_clearance_m


def is_drivable(clearance: ClearanceMap, sources: Pose, targets: Pose) -> NDArray[np.bool_]:
    """Say for N pairs of exact poses (N, 3) whether a robot could drive the edge, (N,); else it is spurious.

    Spurious: the straight line is blocked, or the poses are more than 2.8 m or 1.6 rad apart.
    """
    sources, targets = np.broadcast_arrays(np.atleast_2d(sources), np.atleast_2d(targets))
    waypoints = relative(sources, targets)
    near = np.hypot(waypoints[:, 0], waypoints[:, 1]) <= SPURIOUS_DISTANCE_M
    aligned = np.abs(waypoints[:, 2]) <= SPURIOUS_YAW_RAD
    return near & aligned & is_line_free(clearance, sources, targets)
