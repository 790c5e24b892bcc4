"""Tells from the newest depth image whether the robot may drive forward. Owns the corridor before it.

Where no fresh depth says that the way is free, it is not: a camera that is covered or dead stops the robot, too.
"""

import threading
import time
from typing import Any

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.errors import LtvnError, RobotError
from ltvn_core.robots.ros2.profile import RobotProfile
from ltvn_core.robots.ros2.ros_cameras import is_calibrated, ros_camera
from ltvn_core.robots.ros2.sensor_images import sensor_depth, sensor_size
from ltvn_core.robots.ros2.zenoh_link import Received
from ltvn_core.types import Depth, Twist

FRESH_S = 0.5
_EVERY_PIXEL = 4
_FLOOR_M = 0.03
"""Depth is so inaccurate that the floor seems to rise by this."""
_FEW_POINTS = 3
"""Fewer than so many points are noise."""


class DepthStop:
    """Refuses forward motion where something stands within `stop_m` of the body."""

    def __init__(self, profile: RobotProfile, stop_m: float) -> None:
        """Nothing was seen yet, so nothing is free."""
        self.reason: str | None = "no depth image came yet"
        """Why forward is refused; None where it is not."""
        self._profile = profile
        self._stop_m = stop_m
        self._seen_s = 0.0
        self._info: Any = None
        self._lock = threading.Lock()

    def allows(self, twist: Twist) -> Twist:
        """Return the command without what leads forward where that is refused; turning stays, and backing up."""
        with self._lock:
            if time.monotonic() - self._seen_s > FRESH_S:
                self.reason = "no fresh depth image came"
            is_free = self.reason is None
        return twist if is_free or twist.linear_m_s <= 0 else Twist(0.0, twist.angular_rad_s)

    def take_camera_info(self, received: Received) -> None:
        """Learn the lens."""
        self._info = received.message

    def take_depth(self, received: Received) -> None:
        """Look at an image. Raises RobotError where it is none."""
        message, topic = received.message, self._profile.topics.depth
        if self._info is None or not is_calibrated(self._info):
            return
        camera, size = self._profile.camera, sensor_size(message, topic)
        depth = sensor_depth(message, topic, camera.depth_unit_m)
        try:
            lens = ros_camera(self._info, *size, rectified=camera.rectified, topic=topic)
        except LtvnError as error:
            raise RobotError(str(error)) from error
        reason = self._reason(depth, self._profile.mounted(lens))
        with self._lock:
            self.reason, self._seen_s = reason, received.arrived_s

    def _reason(self, depth: Depth, camera: CameraModel) -> str | None:
        """Say why forward is refused."""
        if not depth.any():
            return "the depth image is empty"
        sparse = depth[::_EVERY_PIXEL, ::_EVERY_PIXEL]
        points = camera.scaled(sparse.shape[1], sparse.shape[0]).unproject_image(sparse)
        body = self._profile.body
        before = (points[:, 0] > 0) & (points[:, 0] < body.radius_m + self._stop_m)
        beside = abs(points[:, 1]) < body.radius_m
        high = (points[:, 2] > body.ground_clearance_m + _FLOOR_M) & (points[:, 2] < body.height_m)
        hits = points[before & beside & high]
        if len(hits) < _FEW_POINTS:
            return None
        return f"something stands {hits[:, 0].min() - body.radius_m:.2f} m before the robot"
