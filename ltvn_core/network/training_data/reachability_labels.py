"""Labels pairs as reachable by the criteria of section III-B of the paper, with the limits of each criterion.

Owns the limits, the combination of the criteria to a label, and the geometry of each criterion over N pairs.
"""

from dataclasses import dataclass
from enum import IntFlag
from math import radians
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.geometry import relative
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.types import Pose, Waypoint

POINT_STEP = 3
"""Step in pixels between the sampled pixels, along rows and columns."""

_HORIZON_ABOVE_PX = 3
_HORIZON_BELOW_PX = 10
"""Number of rows above and below the horizon in which a camera at the target would appear; its mast extends below
it."""

OBSTACLE_LOW_M = 0.1
OBSTACLE_HIGH_M = 0.9
"""Surfaces between these heights above the floor are obstacles for the robot."""


class FreeSpace(Protocol):
    """Free space of a scene: distances to obstacles and paths between them, for the centre of the robot."""

    def at(self, xy: ArrayLike) -> NDArray[np.float64]:
        """Return the distances (...) in metres from points (..., 2) to the nearest obstacle."""
        ...

    def along(self, starts: ArrayLike, ends: ArrayLike) -> NDArray[np.float64]:
        """Return the smallest clearance (N,) on straight lines from starts (N, 2) to ends (N, 2)."""
        ...

    def sample_poses(self, rng: np.random.Generator, count: int, *, min_clearance_m: float = ...) -> Pose:
        """Draw free poses (count, 3)."""
        ...

    def path(self, start: ArrayLike, goal: ArrayLike) -> NDArray[np.float64] | None:
        """Return a path (M, 2) from start (2,) to goal (2,), or None if there is none."""
        ...

    def path_lengths(self, start: ArrayLike, goals: ArrayLike, *, limit_m: float = ...) -> NDArray[np.float64]:
        """Return the lengths (N,) in metres of the shortest paths from start (2,) to goals (N, 2); inf if none."""
        ...


def straight_m(waypoints: Waypoint) -> NDArray[np.float64]:
    """Return the straight distances (N,) in metres."""
    return np.hypot(waypoints[:, 0], waypoints[:, 1])


def in_view(waypoints: Waypoint, camera: CameraModel, *, beside_rad: float = 0.0) -> NDArray[np.bool_]:
    """Return whether the target's position is at most `beside_rad` outside the horizontal field of view, (N,)."""
    fov_rad = camera.horizontal_fov_rad + 2 * beside_rad
    return (waypoints[:, 0] > 0) & (np.abs(np.arctan2(waypoints[:, 1], waypoints[:, 0])) < fov_rad / 2)


def unobstructed(
    waypoints: Waypoint, source_depth: NDArray[np.floating], camera: CameraModel, *, tolerance_m: float
) -> NDArray[np.bool_]:
    """Return whether the source's depth (N, H, W) reaches the target's position up to `tolerance_m`, (N,).

    Only valid where the position is in view.
    """
    ahead = np.maximum(waypoints[:, 0], 0.01)
    column = np.floor(camera.cx + 0.5 - camera.fx * waypoints[:, 1] / ahead)
    column = np.clip(column, 0, camera.width - 1).astype(np.intp)
    horizon = int(camera.cy + 0.5)
    rows = np.arange(max(horizon - _HORIZON_ABOVE_PX, 0), min(horizon + _HORIZON_BELOW_PX, camera.height))
    seen = source_depth[np.arange(len(waypoints))[:, None], rows, column[:, None]]
    return np.where(seen > 0, seen, np.inf).min(1) > waypoints[:, 0] - tolerance_m


def overlap(
    waypoints: Waypoint,
    source_depth: NDArray[np.floating],
    target_depth: NDArray[np.floating],
    camera: CameraModel,
) -> NDArray[np.float64]:
    """Return the share (N,) of the target's surface points that the source sees, from depths (N, H, W) in metres.

    The share is not symmetric: after driving forward, the target shows only a part of the source's view, but the source
    shows most of the target's view.
    """
    x, y, z = _sampled_points(target_depth, camera)
    cos, sin = (f(waypoints[:, 2:]).astype(np.float32) for f in (np.cos, np.sin))
    ahead = cos * x - sin * y + waypoints[:, :1].astype(np.float32)
    left = sin * x + cos * y + waypoints[:, 1:2].astype(np.float32)
    visible, seen = _sample_depth(np.stack([ahead, left, z]), source_depth, camera)
    visible &= (x > 0) & (np.abs(seen - ahead) < 0.1 * ahead + 0.05)
    return visible.sum(1) / np.maximum((x > 0).sum(1), 1)


def clearance_from_depth(
    waypoints: Waypoint, source_depth: NDArray[np.floating], camera: CameraModel
) -> NDArray[np.float64]:
    """Return the distance in metres (P,) from the straight line to each waypoint to the nearest visible obstacle.

    It replaces the clearance map if there is none. Obstacles that the source does not see are ignored.

    Args:
        waypoints: (P, 3) targets in the source's frame.
        source_depth: (P, H, W) in metres.
        camera: The camera of the depth images.

    Returns:
        (P,) distances; infinity where nothing is seen at the height of the robot.
    """
    depth, left, height = _sampled_points(source_depth, camera)
    height = height + camera.height_m
    ends = waypoints[:, :2].astype(np.float32)
    length = np.maximum((ends**2).sum(1, keepdims=True), 1e-6)
    ahead_x, ahead_y = ends[:, :1], ends[:, 1:]
    # Projection of each point onto the segment from the robot to the waypoint, as a share of its length.
    along = np.clip((depth * ahead_x + left * ahead_y) / length, 0, 1)
    beside = np.hypot(depth - along * ahead_x, left - along * ahead_y)
    is_obstacle = (depth > 0) & (height > OBSTACLE_LOW_M) & (height < OBSTACLE_HIGH_M)
    return np.where(is_obstacle, beside, np.inf).min(1).astype(np.float64)


def path_ratio(sources: Pose, targets: Pose, floor: FreeSpace, *, limit: float) -> NDArray[np.float64]:
    """Return (shortest feasible path) / (straight line) for N pairs; inf if it is clearly above `limit`.

    A pair closer than the resolution of the grid counts as 5 cm apart.
    """
    straight = np.maximum(np.hypot(*(targets - sources)[:, :2].T), 0.05)
    ratio = np.full(len(sources), np.inf)
    starts, owner = np.unique(sources[:, :2], axis=0, return_inverse=True)
    for number, start in enumerate(starts):
        rows = np.flatnonzero(owner.reshape(-1) == number)
        reach = float(straight[rows].max()) * limit + 0.5
        ratio[rows] = floor.path_lengths(start, targets[rows, :2], limit_m=reach) / straight[rows]
    return np.maximum(ratio, 1.0)


def _sampled_points(depth: NDArray[np.floating], camera: CameraModel) -> NDArray[np.float32]:
    """Return the points (3, N, M) of the sampled pixels of depths (N, H, W): ahead, left and up of the camera."""
    half = POINT_STEP // 2
    rows = np.arange(half, camera.height, POINT_STEP)
    columns = np.arange(half, camera.width, POINT_STEP)
    up, left = np.meshgrid((camera.cy - rows) / camera.fy, (camera.cx - columns) / camera.fx, indexing="ij")
    metres = depth[:, half::POINT_STEP, half::POINT_STEP].reshape(len(depth), up.size).astype(np.float32)
    return np.stack([metres, metres * left.ravel().astype(np.float32), metres * up.ravel().astype(np.float32)])


def _sample_depth(
    points: NDArray[np.float32], depth: NDArray[np.floating], camera: CameraModel
) -> tuple[NDArray[np.bool_], NDArray[np.float32]]:
    """Return whether points (3, N, M) project into images (N, H, W), and the depth at those pixels (N, M)."""
    ahead = points[0] > 0.05
    safe = np.where(ahead, points[0], 1)
    column = camera.cx + 0.5 - camera.fx * points[1] / safe
    row = camera.cy + 0.5 - camera.fy * points[2] / safe
    inside = ahead & (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
    column = np.clip(column, 0, camera.width - 1).astype(np.intp)
    row = np.clip(row, 0, camera.height - 1).astype(np.intp)
    return inside, depth[np.arange(len(depth))[:, None], row, column].astype(np.float32)


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

    reachable: NDArray[np.bool_]
    """(N,) whether the pair meets all criteria."""
    failed: NDArray[np.uint8]
    """(N,) flags of `FailedCriteria`; 0 where reachable."""
    overlap: NDArray[np.float32]
    """(N,) share of the target's points that the source sees; nan where not measured."""
    path_ratio: NDArray[np.float32]
    """(N,) ratio of the path to the straight line; nan where not measured."""


def label_poses(
    sources: Pose,
    targets: Pose,
    source_depth: NDArray[np.floating],
    target_depth: NDArray[np.floating],
    floor: FreeSpace,
    *,
    limits: ReachabilityLimits | None = None,
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
    """
    limits = limits or ReachabilityLimits()
    camera = LOCOBOT.camera
    waypoints = relative(sources, targets)
    straight = straight_m(waypoints)
    visible = in_view(waypoints, camera) & unobstructed(waypoints, source_depth, camera, tolerance_m=limits.occlusion_m)
    visible |= straight < limits.at_place_m
    failed = np.where(straight < limits.distance_m, 0, FailedCriteria.DISTANCE).astype(np.uint8)
    failed |= np.where(np.abs(waypoints[:, 2]) < limits.yaw_rad, 0, FailedCriteria.YAW).astype(np.uint8)
    failed |= np.where(visible, 0, FailedCriteria.VISIBILITY).astype(np.uint8)
    shared = np.full(len(waypoints), np.nan)
    ratio = np.full(len(waypoints), np.nan)
    rows = np.flatnonzero(failed == 0)
    shared[rows] = overlap(waypoints[rows], source_depth[rows], target_depth[rows], camera)
    failed[rows] |= np.where(shared[rows] > limits.overlap, 0, FailedCriteria.OVERLAP).astype(np.uint8)
    rows = np.flatnonzero(failed == 0)
    ratio[rows] = path_ratio(sources[rows], targets[rows], floor, limit=limits.path_ratio)
    failed[rows] |= np.where(ratio[rows] < limits.path_ratio, 0, FailedCriteria.PATH).astype(np.uint8)
    clearance = floor.along(sources[:, :2], targets[:, :2])
    failed |= np.where(clearance > limits.line_clearance_m, 0, FailedCriteria.LINE).astype(np.uint8)
    return PairLabels(
        reachable=failed == 0,
        failed=failed,
        overlap=shared.astype(np.float32),
        path_ratio=ratio.astype(np.float32),
    )
