"""Where a place on the floor appears in a picture, and where the points of a depth image lie.

Owns the two projections of the level camera, and the shape by which a waypoint is drawn. Draws nothing.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ltvn_core.types import Depth, Intrinsics, Waypoint

ROBOT_RADIUS_M = 0.18
"""The ring that is drawn at a waypoint is as large as the robot."""

_NEAREST_M = 0.08
"""What is nearer than this is not drawn."""


class WaypointOutline(NamedTuple):
    """Lines in a picture that show a waypoint: (K, 2) columns and rows in pixels, nan where they are not ahead."""

    ring: NDArray[np.float64]
    """The robot's outline on the floor."""
    heading: NDArray[np.float64]
    """From its middle to where it looks."""
    mast: NDArray[np.float64]
    """From the floor to the camera."""


def project(points: NDArray[np.floating], camera: Intrinsics | None = None) -> NDArray[np.float64]:
    """Return columns and rows (N, 2) of points (N, 3): metres ahead, left, and above the floor; nan behind."""
    camera = camera or Intrinsics()
    ahead = np.where(points[:, 0] > _NEAREST_M, points[:, 0], np.nan)
    column = camera.width / 2 - camera.focal_px * points[:, 1] / ahead
    row = camera.height / 2 - camera.focal_px * (points[:, 2] - camera.height_m) / ahead
    return np.column_stack([column, row])


def unproject(depth: Depth, camera: Intrinsics | None = None) -> NDArray[np.float32]:
    """Return the points (M, 3) of a depth image (H, W) that have depth: metres ahead, left, and above the floor."""
    camera = camera or Intrinsics()
    rows, columns = np.nonzero(depth > 0)
    ahead = depth[rows, columns]
    left = (camera.width / 2 - columns - 0.5) / camera.focal_px * ahead
    above = (camera.height / 2 - rows - 0.5) / camera.focal_px * ahead + camera.height_m
    return np.column_stack([ahead, left, above]).astype(np.float32)


def waypoint_outline(waypoint: Waypoint, camera: Intrinsics | None = None) -> WaypointOutline:
    """Return how a waypoint (3,) looks from its source."""
    camera = camera or Intrinsics()
    x, y, yaw = waypoint
    angles = yaw + np.linspace(0, 2 * np.pi, 33)
    ring = np.column_stack([x + ROBOT_RADIUS_M * np.cos(angles), y + ROBOT_RADIUS_M * np.sin(angles), 0 * angles])
    reach = 2.2 * ROBOT_RADIUS_M
    heading = np.array([[x, y, 0], [x + reach * np.cos(yaw), y + reach * np.sin(yaw), 0]])
    mast = np.array([[x, y, 0], [x, y, camera.height_m]])
    return WaypointOutline(*(project(line, camera) for line in (ring, heading, mast)))
