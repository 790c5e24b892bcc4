"""Projection and unprojection of the level camera, and the outline of a waypoint in an image. Draws nothing."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.types import Depth, Waypoint

ROBOT_RADIUS_M = LOCOBOT.clear_radius_m
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


def project(points: NDArray[np.floating], camera: CameraModel | None = None) -> NDArray[np.float64]:
    """Return the pixels (N, 2), columns and rows, of points (N, 3); nan for points behind the camera.

    Points are metres ahead of the camera, to its left, and above the floor.
    """
    camera = camera or LOCOBOT.camera
    near = points[:, 0] <= _NEAREST_M
    return np.where(near[:, None], np.nan, camera.project(points) + 0.5)


def unproject(depth: Depth, camera: CameraModel | None = None) -> NDArray[np.float32]:
    """Return the points (M, 3) of a depth image (H, W) where it is not 0: metres ahead, left, and above the floor."""
    return (camera or LOCOBOT.camera).unproject_image(depth).astype(np.float32)


def waypoint_outline(waypoint: Waypoint, camera: CameraModel | None = None) -> WaypointOutline:
    """Return the outline of a waypoint (3,) in the image of its source."""
    camera = camera or LOCOBOT.camera
    x, y, yaw = waypoint
    angles = yaw + np.linspace(0, 2 * np.pi, 33)
    ring = np.column_stack([x + ROBOT_RADIUS_M * np.cos(angles), y + ROBOT_RADIUS_M * np.sin(angles), 0 * angles])
    reach = 2.2 * ROBOT_RADIUS_M
    heading = np.array([[x, y, 0], [x + reach * np.cos(yaw), y + reach * np.sin(yaw), 0]])
    mast = np.array([[x, y, 0], [x, y, camera.height_m]])
    return WaypointOutline(ring=project(ring, camera), heading=project(heading, camera), mast=project(mast, camera))
