"""The geometry of the reachability criteria (section III-B of the paper), each a small function over N pairs.

The limits, and how the criteria combine to a label, are in
`ltvn_core.training_data.reachability_labels`.
"""

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.training_data.scene_protocols import FreeSpace
from ltvn_core.types import Pose, Waypoint

POINT_STEP = 3
"""Every third pixel of a row and of a column is sampled."""

_HORIZON_ABOVE_PX = 3
_HORIZON_BELOW_PX = 10
"""A camera at the target would appear in these rows around the horizon; its mast extends below it."""

OBSTACLE_LOW_M = 0.1
OBSTACLE_HIGH_M = 0.9
"""Surfaces between these heights above the floor are obstacles for the robot."""


def straight_m(waypoints: Waypoint) -> NDArray[np.float64]:
    """Return the straight distances (N,) in metres."""
    return np.hypot(waypoints[:, 0], waypoints[:, 1])


def bearing_rad(waypoints: Waypoint) -> NDArray[np.float64]:
    """Return the directions (N,) in radians from the source to the target's position, positive to the left."""
    return np.arctan2(waypoints[:, 1], waypoints[:, 0])


def in_view(waypoints: Waypoint, camera: CameraModel, *, beside_rad: float = 0.0) -> NDArray[np.bool_]:
    """Return whether the target's position is at most `beside_rad` outside the horizontal field of view, (N,)."""
    fov_rad = camera.horizontal_fov_rad + 2 * beside_rad
    return (waypoints[:, 0] > 0) & (np.abs(bearing_rad(waypoints)) < fov_rad / 2)


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
    return _far_if_missing(seen).min(1) > waypoints[:, 0] - tolerance_m


def overlap(
    waypoints: Waypoint,
    source_depth: NDArray[np.floating],
    target_depth: NDArray[np.floating],
    camera: CameraModel,
) -> NDArray[np.float64]:
    """Return the share (N,) of the target's surface points that the source sees, from depths (N, H, W) in metres.

    Not symmetric: after driving forward the target sees only a part of what the source sees, but the source sees most
    of what the target sees.
    """
    rays = _rays(camera)
    half = POINT_STEP // 2
    metres = target_depth[:, half::POINT_STEP, half::POINT_STEP].reshape(len(waypoints), rays.shape[1])
    metres = metres.astype(np.float32)
    x, y = metres, metres * rays[0]
    cos, sin = (f(waypoints[:, 2:]).astype(np.float32) for f in (np.cos, np.sin))
    ahead = cos * x - sin * y + waypoints[:, :1].astype(np.float32)
    left = sin * x + cos * y + waypoints[:, 1:2].astype(np.float32)
    visible, seen = _sample_depth(np.stack([ahead, left, metres * rays[1]]), source_depth, camera)
    visible &= (metres > 0) & (np.abs(seen - ahead) < 0.1 * ahead + 0.05)
    return visible.sum(1) / np.maximum((metres > 0).sum(1), 1)


def clearance_from_depth(
    waypoints: Waypoint, source_depth: NDArray[np.floating], camera: CameraModel
) -> NDArray[np.float64]:
    """Return the distance in metres (P,) from the straight line to each waypoint to the nearest visible obstacle.

    It replaces the clearance map where there is none. Obstacles that the source does not see are not noticed.

    Args:
        waypoints: (P, 3) targets in the source's frame.
        source_depth: (P, H, W) in metres.
        camera: The camera of the depth images.

    Returns:
        (P,) distances; infinity where nothing is seen at the height of the robot.
    """
    half = POINT_STEP // 2
    rows = np.arange(half, camera.height, POINT_STEP)
    columns = np.arange(half, camera.width, POINT_STEP)
    depth = source_depth[:, half::POINT_STEP, half::POINT_STEP].astype(np.float32)
    left = ((camera.cx - columns) / camera.fx).astype(np.float32) * depth
    height = ((camera.cy - rows) / camera.fy)[:, None].astype(np.float32) * depth + camera.height_m
    ends = waypoints[:, :2].astype(np.float32)
    length = np.maximum((ends**2).sum(1), 1e-6)
    ahead_x = ends[:, 0, None, None]
    ahead_y = ends[:, 1, None, None]
    # Projection of each point onto the segment from the robot to the waypoint, as a share of its length.
    along = np.clip((depth * ahead_x + left * ahead_y) / length[:, None, None], 0, 1)
    beside = np.hypot(depth - along * ahead_x, left - along * ahead_y)
    is_obstacle = (depth > 0) & (height > OBSTACLE_LOW_M) & (height < OBSTACLE_HIGH_M)
    return np.where(is_obstacle, beside, np.inf).min((1, 2)).astype(np.float64)


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


def _rays(camera: CameraModel) -> NDArray[np.float32]:
    """Return the left and up coordinates (2, M) of the sampled pixels at one metre of depth."""
    half = POINT_STEP // 2
    rows = np.arange(half, camera.height, POINT_STEP)
    columns = np.arange(half, camera.width, POINT_STEP)
    up, left = np.meshgrid((camera.cy - rows) / camera.fy, (camera.cx - columns) / camera.fx, indexing="ij")
    return np.stack([left.ravel(), up.ravel()]).astype(np.float32)


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


def _far_if_missing(depth: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return depths with infinity where the sensor returned nothing."""
    return np.where(depth > 0, depth, np.inf)
