"""Projection and unprojection of the level camera, and the outline of a waypoint in an image. Draws nothing."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ltvn_core.types import Depth, Intrinsics, Waypoint

ROBOT_RADIUS_M = 0.18
"""Radius of the ring that marks a waypoint."""

_NEAREST_M = 0.08
"""Points closer to the image plane than this are not projected."""


class WaypointOutline(NamedTuple):
    """Lines that mark a waypoint in an image: (K, 2) columns and rows in pixels, nan where they are not ahead."""

    ring: NDArray[np.float64]
    """Outline of the robot on the floor."""
    heading: NDArray[np.float64]
    """From the centre of the robot in the direction of its heading."""
    mast: NDArray[np.float64]
    """From the floor to the camera."""


def project(points: NDArray[np.floating], camera: Intrinsics | None = None) -> NDArray[np.float64]:
    """Return the pixels (N, 2), columns and rows, of points (N, 3); nan for points behind the camera.

    Points are metres ahead of the camera, to its left, and above the floor.
    """
    camera = camera or Intrinsics()
    ahead = np.where(points[:, 0] > _NEAREST_M, points[:, 0], np.nan)
    column = camera.width / 2 - camera.focal_px * points[:, 1] / ahead
    row = camera.height / 2 - camera.focal_px * (points[:, 2] - camera.height_m) / ahead
    return np.column_stack([column, row])


def unproject(depth: Depth, camera: Intrinsics | None = None) -> NDArray[np.float32]:
    """Return the points (M, 3) of a depth image (H, W) where it is not 0: metres ahead, left, and above the floor."""
    camera = camera or Intrinsics()
    rows, columns = np.nonzero(depth > 0)
    ahead = depth[rows, columns]
    left = (camera.width / 2 - columns - 0.5) / camera.focal_px * ahead
    above = (camera.height / 2 - rows - 0.5) / camera.focal_px * ahead + camera.height_m
    return np.column_stack([ahead, left, above]).astype(np.float32)


def waypoint_outline(waypoint: Waypoint, camera: Intrinsics | None = None) -> WaypointOutline:
    """Return the outline of a waypoint (3,) in the image of its source."""
    camera = camera or Intrinsics()
    x, y, yaw = waypoint
    angles = yaw + np.linspace(0, 2 * np.pi, 33)
    ring = np.column_stack([x + ROBOT_RADIUS_M * np.cos(angles), y + ROBOT_RADIUS_M * np.sin(angles), 0 * angles])
    reach = 2.2 * ROBOT_RADIUS_M
    heading = np.array([[x, y, 0], [x + reach * np.cos(yaw), y + reach * np.sin(yaw), 0]])
    mast = np.array([[x, y, 0], [x, y, camera.height_m]])
    return WaypointOutline(ring=project(ring, camera), heading=project(heading, camera), mast=project(mast, camera))
