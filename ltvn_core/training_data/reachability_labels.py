"""Joins the criteria into labels: which pairs are reachable, and which criterion the others fail.

Owns the limits. The geometry is in `ltvn_core.training_data.reachability_criteria`.
"""

from dataclasses import dataclass
from enum import IntFlag
from math import radians
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ltvn_core.geometry import relative
from ltvn_core.training_data import reachability_criteria
from ltvn_core.training_data.scene_protocols import FreeSpace
from ltvn_core.types import Intrinsics, Pose, Waypoint


class FailedCriteria(IntFlag):
    """Criteria that a pair fails. Overlap and path are only measured where the cheaper ones hold."""

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
    """L_min: least share of the target's points that the source must see (criterion: paper). Below it the waypoint is
    a guess: from 0.25 to 0.35, the error's 90th percentile was 0.6 m."""
    path_ratio: float = 1.15
    """R_max: longest feasible path against the straight line (criterion: paper)."""
    distance_m: float = 2.5
    """E_max: greatest straight distance (criterion: paper)."""
    yaw_rad: float = radians(45)
    """Theta_max: greatest turn (criterion: paper)."""
    occlusion_m: float = 0.15
    """The target's place counts as visible if depth ends at most this far before it (criterion: paper)."""
    at_place_m: float = 0.25
    """A target this near need not lie ahead: the robot already stands there (ours)."""
    line_clearance_m: float = 0.18
    """Least clearance on the straight way, the robot's radius: the controller drives nearly straight (ours)."""


class PairLabels(NamedTuple):
    """Labels of N pairs."""

    waypoints: Waypoint
    """(N, 3) target in the source's frame."""
    reachable: NDArray[np.bool_]
    """(N,)"""
    failed: NDArray[np.uint8]
    """(N,) flags of `FailedCriteria`; 0 where reachable."""
    overlap: NDArray[np.float32]
    """(N,) share of the target's points that the source sees; nan where not measured."""
    path_ratio: NDArray[np.float32]
    """(N,) path against straight line; nan where not measured."""
    line_clearance_m: NDArray[np.float32]
    """(N,) least clearance on the straight line."""


def label_poses(
    sources: Pose,
    targets: Pose,
    source_depth: NDArray[np.floating],
    target_depth: NDArray[np.floating],
    floor: FreeSpace,
    *,
    limits: ReachabilityLimits | None = None,
    camera: Intrinsics | None = None,
) -> PairLabels:
    """Label N pairs of poses (N, 3) whose depth images (N, H, W) are in metres.

    Reachable means: near, turned little, the target's place visible ahead (or underfoot), enough overlap, a feasible
    path hardly longer than the straight line, and that line wide enough for the robot.
    """
    limits = limits or ReachabilityLimits()
    camera = camera or Intrinsics()
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
    return PairLabels(waypoints, failed == 0, failed, *(x.astype(np.float32) for x in (shared, ratio, clearance)))


def _failures_without_overlap(
    waypoints: Waypoint, source_depth: NDArray[np.floating], limits: ReachabilityLimits, camera: Intrinsics
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
