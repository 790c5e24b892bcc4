"""The oracle predictor: a `Predictor` that answers from exact poses and the clearance map instead of images.

It separates errors of the network from errors of the method, and exists only in simulation. Also defines which edges
are spurious, as ground truth for evaluation.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.config import Likelihoods
from ltvn_core.geometry import relative
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.simulation.clearance_map import ClearanceMap
from ltvn_core.types import Features, Observation, Pose, Prediction, Waypoint

REACHABLE = 0.97
UNREACHABLE = 0.03
"""The reachabilities that the oracle returns; they are not 0 and 1, because no evidence could revise a certain
belief."""

LIKELIHOODS = Likelihoods(0.98, 0.02, 1e-4)
"""Likelihoods of Eq. 3 and variance of Eq. 4 for a method with this predictor.

With exact waypoints, the robot nearly always reaches a reachable target, and hardly ever an unreachable one. No
likelihood is 0 or 1, and sigma is one centimetre instead of zero, because a map with certain beliefs could no longer
change.
"""

MAX_DISTANCE_M = 2.5
"""E_max of the paper's reachability criteria; the value is ours."""
MAX_YAW_RAD = float(np.deg2rad(60))
"""Theta_max of the paper's reachability criteria; the value is ours."""
VIEW_NOT_NEEDED_M = 0.25
"""A target nearer than this is reachable even when it lies outside the field of view."""
MIN_CLEARANCE_M = LOCOBOT.clear_radius_m
"""Clearance that the robot's centre needs on the straight line to a reachable target."""

SPURIOUS_DISTANCE_M = 2.8
SPURIOUS_YAW_RAD = 1.6
SPURIOUS_CLEARANCE_M = 0.15
"""Limits of distance, heading and clearance for drivable edges of the map. They are looser than those of the predictor,
so that an edge is not spurious because of a rounding of the clearance map or a wall along which the robot slides."""


class OraclePredictor:
    """Predicts from the ground truth. Implements `ltvn_core.types.Predictor`; its features are exact poses (N, 3)."""

    fingerprint = "oracle"
    likelihoods = LIKELIHOODS

    def __init__(self, clearance: ClearanceMap, camera: CameraModel = LOCOBOT.camera) -> None:
        self._clearance = clearance
        self.camera = camera
        self._half_fov_rad = camera.horizontal_fov_rad / 2

    def show(self, clearance: ClearanceMap) -> None:
        """Predict from another clearance map, after the world has changed."""
        self._clearance = clearance

    def encode(self, observations: Sequence[Observation]) -> Features:
        """Return the exact poses (N, 3) of the observations.

        Raises:
            ValueError: An observation has no exact pose, because it was not taken in simulation.
        """
        poses = [observation.exact_pose for observation in observations]
        for observation, pose in zip(observations, poses, strict=True):
            if pose is None:
                raise ValueError(
                    f"The oracle needs the exact pose of each image, and image {observation.step} has none, because "
                    "it was not taken in simulation. Use another predictor."
                )
        return np.array(poses, np.float64).reshape(-1, 3)

    def predict(self, sources: Features, targets: Features) -> Prediction:
        """Return exact waypoints (N, 3) and reachabilities (N,) of 0.97 or 0.03.

        Args:
            sources: Exact poses (N, 3), or (1, 3) for one source and N targets.
            targets: Exact poses (N, 3).
        """
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
    """Return for N pairs of poses (N, 3) whether the straight line between them has more than a clearance, (N,)."""
    if len(starts) == 0:
        return np.zeros(0, bool)
    return np.asarray(clearance.along(starts[:, :2], ends[:, :2])) > min_clearance_m


def is_drivable(clearance: ClearanceMap, sources: Pose, targets: Pose) -> NDArray[np.bool_]:
    """Return for N pairs of exact poses (N, 3) whether a robot can drive the edge, (N,).

    An edge that is not drivable is spurious: its straight line is blocked, or its poses are more than 2.8 m or 1.6 rad
    apart.
    """
    sources, targets = np.broadcast_arrays(np.atleast_2d(sources), np.atleast_2d(targets))
    waypoints = relative(sources, targets)
    near = np.hypot(waypoints[:, 0], waypoints[:, 1]) <= SPURIOUS_DISTANCE_M
    aligned = np.abs(waypoints[:, 2]) <= SPURIOUS_YAW_RAD
    return near & aligned & is_line_free(clearance, sources, targets)
