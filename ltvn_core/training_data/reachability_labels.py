"""Labels pairs as reachable by the criteria of section III-B of the paper, with the limits of each criterion.

The geometry of the criteria is in `ltvn_core.training_data.reachability_criteria`.
"""

from dataclasses import dataclass
from enum import IntFlag
from math import radians
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.geometry import relative
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.training_data import reachability_criteria
from ltvn_core.training_data.scene_protocols import FreeSpace
from ltvn_core.types import Pose, Waypoint


class FailedCriteria(IntFlag):
    """The criteria that a pair fails. Overlap and path are measured only where the cheaper criteria hold."""

    NOTHING = 0
    DISTANCE = 1
    YAW = 2
    VISIBILITY = 4
    OVERLAP = 8
    PATH = 16
    LINE = 32


@dataclass(frozen=True, slots=True)
class ReachabilityLimits:
    """Limits of the criteria. The paper names the first five and states no value; all values are ours."""

    overlap: float = 0.4
    """L_min: smallest share of the target's points that the source must see (criterion: paper). Waypoints below it are
    unreliable: between 0.25 and 0.35 the 90th percentile of their error was 0.6 m."""
    path_ratio: float = 1.15
    """R_max: largest ratio of the feasible path to the straight line (criterion: paper)."""
    distance_m: float = 2.5
    """E_max: largest straight distance (criterion: paper)."""
    yaw_rad: float = radians(45)
    """Theta_max: largest difference of heading (criterion: paper)."""
    occlusion_m: float = 0.15
    """The target's position is visible if the depth there is at most this much too short (criterion: paper)."""
    at_place_m: float = 0.25
    """A target closer than this need not be visible, because the robot is already there (ours)."""
    line_clearance_m: float = LOCOBOT.clear_radius_m
    """Smallest clearance of the straight line, the robot's radius: the controller drives nearly straight (ours)."""


class PairLabels(NamedTuple):
    """Labels of N pairs."""

    waypoints: Waypoint
    """(N, 3) pose of the target in the source's frame."""
    reachable: NDArray[np.bool_]
    """(N,) whether the pair meets all criteria."""
    failed: NDArray[np.uint8]
    """(N,) flags of `FailedCriteria`; 0 where reachable."""
    overlap: NDArray[np.float32]
    """(N,) share of the target's points that the source sees; nan where not measured."""
    path_ratio: NDArray[np.float32]
    """(N,) ratio of the path to the straight line; nan where not measured."""
    line_clearance_m: NDArray[np.float32]
    """(N,) smallest clearance on the straight line."""


def label_poses(
    sources: Pose,
    targets: Pose,
    source_depth: NDArray[np.floating],
    target_depth: NDArray[np.floating],
    floor: FreeSpace,
    *,
    limits: ReachabilityLimits | None = None,
    camera: CameraModel | None = None,
) -> PairLabels:
    """Label N pairs of poses by all criteria.

    Reachable means: close, a small difference of heading, the target's position visible (or under the robot), enough
    overlap, a feasible path hardly longer than the straight line, and enough clearance on that line.

    Args:
        sources: Poses (N, 3).
        targets: Poses (N, 3).
        source_depth: Depth images (N, H, W) in metres at the sources.
        target_depth: Depth images (N, H, W) in metres at the targets.
        floor: Free space of the scene.
        limits: Limits of the criteria.
        camera: The camera of the depth images.
    """
    limits = limits or ReachabilityLimits()
    camera = camera or LOCOBOT.camera
    waypoints = relative(sources, targets)
    failed = _failures_without_overlap(waypoints, source_depth, limits, camera)
    shared = np.full(len(waypoints), np.nan)
    ratio = np.full(len(waypoints), np.nan)
    rows = np.flatnonzero(failed == 0)
    shared[rows] = reachability_criteria.overlap(waypoints[rows], source_depth[rows], target_depth[rows], camera)
    failed[rows] |= np.where(shared[rows] > limits.overlap, 0, FailedCriteria.OVERLAP).astype(np.uint8)
    rows = np.flatnonzero(failed == 0)
    ratio[rows] = reachability_criteria.path_ratio(sources[rows], targets[rows], floor, limit=limits.path_ratio)
    failed[rows] |= np.where(ratio[rows] < limits.path_ratio, 0, FailedCriteria.PATH).astype(np.uint8)
    clearance = floor.along(sources[:, :2], targets[:, :2])
    failed |= np.where(clearance > limits.line_clearance_m, 0, FailedCriteria.LINE).astype(np.uint8)
    return PairLabels(
        waypoints=waypoints,
        reachable=failed == 0,
        failed=failed,
        overlap=shared.astype(np.float32),
        path_ratio=ratio.astype(np.float32),
        line_clearance_m=clearance.astype(np.float32),
    )


def _failures_without_overlap(
    waypoints: Waypoint, source_depth: NDArray[np.floating], limits: ReachabilityLimits, camera: CameraModel
) -> NDArray[np.uint8]:
    straight = reachability_criteria.straight_m(waypoints)
    visible = reachability_criteria.in_view(waypoints, camera) & reachability_criteria.unobstructed(
        waypoints, source_depth, camera, tolerance_m=limits.occlusion_m
    )
    visible |= straight < limits.at_place_m
    failed = np.where(straight < limits.distance_m, 0, FailedCriteria.DISTANCE)
    failed |= np.where(np.abs(waypoints[:, 2]) < limits.yaw_rad, 0, FailedCriteria.YAW)
    failed |= np.where(visible, 0, FailedCriteria.VISIBILITY)
    return failed.astype(np.uint8)
