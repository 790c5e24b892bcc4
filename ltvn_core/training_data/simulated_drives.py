"""Simulated mapping drives without physics: poses along clear paths between random places, with full turns.

Also classifies all ordered image pairs of a drive as near, far or neither, to count false positives. A tour with
physics (`scripted_tour`) gives the same kind of images and may be used instead.
"""

from dataclasses import dataclass
from math import radians

import numpy as np
from numpy.typing import NDArray

from ltvn_core.geometry import lengths_along, points_along, relative, wrap_angle
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.training_data.scene_protocols import FreeSpace
from ltvn_core.types import Pose

ROBOT_RADIUS_M = LOCOBOT.clear_radius_m
"""A straight line is free if its clearance is larger than this."""


@dataclass(frozen=True, slots=True)
class DriveSpacing:
    """Spacing of the images of a drive (all ours, equal to the simulator's tour)."""

    spacing_m: float = 0.12
    """Metres between images along a path."""
    turn_rad: float = radians(10)
    """Rotation between images while turning on the spot."""
    full_turn_share: float = 0.3
    """Share of visited places with a full turn."""


@dataclass(frozen=True, slots=True)
class NearFarLimits:
    """Limits of near and far pairs, for counting false positives (ours)."""

    far_m: float = 3.0
    """Pairs with a larger distance are far."""
    far_rad: float = radians(92)
    """Pairs with a larger difference of heading are far."""
    around_m: float = 3.0
    """Pairs with a blocked straight line are far if the shortest path is longer than this (behind a wall)."""
    near_m: float = 1.2
    """Near pairs have a smaller distance than this,"""
    near_rad: float = radians(34)
    """a smaller difference of heading than this, the target in the field of view, and a free straight line."""


def sample_drive_poses(floor: FreeSpace, rng: np.random.Generator, count: int) -> Pose:
    """Return (count, 3) poses in the order of a drive."""
    spec = DriveSpacing()
    here = floor.sample_poses(rng, 1, min_clearance_m=0.3)[0]
    parts: list[Pose] = [here[None]]
    while sum(map(len, parts)) < count:
        goal = floor.sample_poses(rng, 1, min_clearance_m=0.3)[0]
        path = floor.path(here[:2], goal[:2])
        # A goal in the same place gives no path to follow.
        if path is None or len(path) < 3:
            continue
        parts.append(_along_path(path, parts[-1][-1, 2], spec))
        if rng.random() < spec.full_turn_share:
            parts.append(_turn(parts[-1][-1], 2 * np.pi, spec))
        here = parts[-1][-1]
    return np.concatenate(parts)[:count]


def classify_near_far(poses: Pose, floor: FreeSpace) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which ordered pairs of poses (N, 3) are near and which are far, each (N, N); the diagonal is neither."""
    classes = NearFarLimits()
    near, far = np.zeros((2, len(poses), len(poses)), bool)
    for i in range(len(poses)):
        near[i], far[i] = _classify_targets(i, poses, floor, classes)
    np.fill_diagonal(near, False)
    np.fill_diagonal(far, False)
    return near, far


def _classify_targets(
    i: int, poses: Pose, floor: FreeSpace, classes: NearFarLimits
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return near and far (N,) for the pairs whose source is image i."""
    waypoints = relative(np.broadcast_to(poses[i], poses.shape), poses)
    distance = np.hypot(waypoints[:, 0], waypoints[:, 1])
    turn = np.abs(waypoints[:, 2])
    ahead = np.abs(np.arctan2(waypoints[:, 1], waypoints[:, 0])) < LOCOBOT.camera.horizontal_fov_rad / 2
    far = (distance > classes.far_m) | (turn > classes.far_rad)
    rows = np.flatnonzero(~far)
    clearance = np.full(len(poses), np.inf)
    clearance[rows] = floor.along(np.broadcast_to(poses[i, :2], (len(rows), 2)), poses[rows, :2])
    blocked = np.flatnonzero(clearance <= 0)
    if len(blocked):
        far[blocked] = ~np.isfinite(floor.path_lengths(poses[i, :2], poses[blocked, :2], limit_m=classes.around_m))
    near = (distance < classes.near_m) & (turn < classes.near_rad) & ahead & (clearance > ROBOT_RADIUS_M)
    return near, far


def _along_path(path: NDArray[np.float64], yaw: float, spec: DriveSpacing) -> Pose:
    """Return poses that turn towards a path (M, 2) and follow it, heading to the point 0.4 m ahead."""
    marks_m = np.arange(0, lengths_along(path)[-1], spec.spacing_m)
    here, ahead = points_along(path, marks_m), points_along(path, marks_m + 0.4)
    yaws = np.arctan2(*(ahead - here).T[::-1])
    start = np.array([*here[0], yaw])
    return np.concatenate([_turn(start, float(wrap_angle(yaws[0] - yaw)), spec), np.column_stack([here, yaws])])


def _turn(pose: Pose, angle_rad: float, spec: DriveSpacing) -> Pose:
    """Return the poses of a turn on the spot by an angle, without the initial pose."""
    steps = max(int(abs(angle_rad) / spec.turn_rad), 1)
    yaws = wrap_angle(pose[2] + angle_rad * np.arange(1, steps + 1) / steps)
    return np.column_stack([np.broadcast_to(pose[:2], (steps, 2)), yaws])
