"""The depth stop of the guard: allows forward motion only while fresh depth shows a free corridor ahead.

The corridor is what the body sweeps on the next `stop_m` metres. A return inside is an obstacle. A pixel shows a
cross-section of it free if it looks through the section and its return lies behind. Many neighbouring pixels without a
return are no free way: they are an obstacle nearer than the sensor's least range, glass, something black, or a covered
camera.
"""

import logging
import threading
import time
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.robots.ros2.freshness import Freshness
from ltvn_core.robots.ros2.profile import RobotProfile
from ltvn_core.robots.ros2.ros_cameras import is_calibrated, ros_camera
from ltvn_core.robots.ros2.ros_images import decode_metres, image_size
from ltvn_core.robots.ros2.ros_messages import read_stamp
from ltvn_core.robots.ros2.zenoh_link import Received
from ltvn_core.types import Depth, Twist

FRESH_S = 0.5
"""Greatest age of the depth image, in seconds, including its delay relative to the quickest one."""
_COLUMNS = 160
"""Number of columns to which larger depth images are thinned."""
_FLOOR_M = 0.03
"""Margin above the ground clearance, in metres, for errors of depth."""
_FEW_POINTS = 3
"""Least number of points of an obstacle; fewer points count as noise."""
_SECTIONS = 4
"""Number of cross-sections of the corridor, from the body to its end, that must be shown."""
_HOLE_M = 0.12
"""Side of the squares of a section that must each be shown, in metres; smaller holes are tolerated."""
_HOLE_PX = 5
"""Least side of such a square in pixels, so that single pixels without a return do not stop the robot."""
_SHOWN = 1 / 3
"""Least share of the pixels of a square that show it free."""
_IN_VIEW = 1 / 3
"""Least share of the corridor's end that the camera must have in its field of view."""
_LOG = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class _Section:
    """A cross-section of the corridor in the images of a mounted camera."""

    x_m: float
    """Distance ahead of the robot's centre."""
    inside: NDArray[np.bool_]
    """Pixels (H, W) that look through it."""
    square_px: tuple[int, int]
    """Rows and columns of a square of `_HOLE_M`."""


class _Corridor(NamedTuple):
    """Half the width, and the lowest and highest points, of what must be free before the robot, in metres."""

    radius_m: float
    low_m: float
    height_m: float


@lru_cache(maxsize=2)
def _rays(camera: CameraModel) -> NDArray[np.float64]:
    """Return the points (H, W, 3), relative to the camera, that its pixels see at one metre of depth."""
    pixels = np.stack(np.meshgrid(np.arange(camera.width), np.arange(camera.height)), axis=-1)
    return camera.unproject(pixels, np.ones(pixels.shape[:2])) - (0.0, 0.0, camera.height_m)


@lru_cache(maxsize=2)
def _sections(camera: CameraModel, body: _Corridor, stop_m: float) -> tuple[_Section, ...]:
    """Return the cross-sections of the corridor from the body to its end."""
    rays = _rays(camera)
    low_m, high_m = body.low_m, body.height_m
    side_m = min(_HOLE_M, body.radius_m, high_m - low_m)
    sections = []
    for x_m in map(float, np.linspace(body.radius_m, body.radius_m + stop_m, _SECTIONS)):
        with np.errstate(divide="ignore", invalid="ignore"):
            at_x = rays * (x_m / np.where(rays[..., :1] > 0, rays[..., :1], np.nan))
        up_m = at_x[..., 2] + camera.height_m
        inside = (np.abs(at_x[..., 1]) < body.radius_m) & (up_m > low_m) & (up_m < high_m)
        rows, columns = (max(_HOLE_PX, round(side_m * focal / x_m)) for focal in (camera.fy, camera.fx))
        sections.append(_Section(x_m, inside, (min(rows, camera.height), min(columns, camera.width))))
    return tuple(sections)


@lru_cache(maxsize=2)
def _share_in_view(camera: CameraModel, body: _Corridor, stop_m: float) -> float:
    """Return the share of the end of the corridor that is in the camera's field of view."""
    left = np.linspace(-body.radius_m, body.radius_m, 21)
    up = np.linspace(body.low_m, body.height_m, 21)
    places = np.stack(np.meshgrid(body.radius_m + stop_m, left, up), axis=-1)
    pixels = camera.project(places) + 0.5
    share = float(((pixels >= 0) & (pixels <= (camera.width, camera.height))).all(axis=-1).mean())
    if share < 1:
        _LOG.warning(
            "The depth camera sees %.0f%% of the way %.2f m ahead; the depth stop ignores obstacles in the rest.",
            100 * share,
            stop_m,
        )
    return share


def _sums(flags: NDArray[np.bool_], rows: int, columns: int) -> NDArray[np.int_]:
    """Return the number of True in each window of this size that lies in the image."""
    total = np.pad(flags.cumsum(0).cumsum(1), ((1, 0), (1, 0)))
    return total[rows:, columns:] - total[:-rows, columns:] - total[rows:, :-columns] + total[:-rows, :-columns]


class DepthStop:
    """Refuses forward motion unless depth shows that the next `stop_m` metres before the body are free."""

    def __init__(self, profile: RobotProfile, stop_m: float) -> None:
        """Start without depth, so that forward motion is refused."""
        self.reason: str | None = "no depth image has arrived yet"
        """Reason why forward motion is refused; None if it is allowed."""
        self._profile = profile
        self._stop_m = stop_m
        self._seen_s = 0.0
        self._info: Any = None
        self._freshness = Freshness(profile.topics.depth, most_late_s=FRESH_S)
        self._lock = threading.Lock()

    def allows(self, twist: Twist) -> Twist:
        """Return the command, without its forward speed if that is refused; turning and backing up stay."""
        with self._lock:
            if self._seen_s and time.monotonic() - self._seen_s > FRESH_S:
                self.reason = "no recent depth image has arrived"
            is_free = self.reason is None
        return twist if is_free or twist.linear_m_s <= 0 else Twist(0.0, twist.angular_rad_s)

    def take_camera_info(self, received: Received) -> None:
        """Store the CameraInfo."""
        self._info = received.message

    def take_depth(self, received: Received) -> None:
        """Check whether a depth image shows a free corridor. Raises LtvnError if it is invalid or late."""
        message = received.message
        topic = self._profile.topics.depth
        if self._info is None or not is_calibrated(self._info):
            self._judge("no calibrated CameraInfo has arrived", self._seen_s)
            return
        # The time of the picture, not that of sending: a driver may send late what its camera saw.
        taken = received.attachment._replace(stamp_ns=round(read_stamp(message, topic) * 1e9))
        late_s = self._freshness.admit(taken, received.arrived_s)
        camera = self._profile.camera
        size = image_size(message, topic)
        depth = decode_metres(message, topic, camera.depth_unit_m)
        lens = ros_camera(self._info, *size, rectified=camera.rectified, topic=topic)
        self._judge(self._reason(depth, self._profile.mounted(lens)), received.arrived_s - late_s)

    def _judge(self, reason: str | None, seen_s: float) -> None:
        with self._lock:
            self.reason = reason
            self._seen_s = seen_s

    def _reason(self, depth: Depth, camera: CameraModel) -> str | None:
        """Return the reason to refuse forward motion; None if there is none."""
        step = max(1, round(camera.width / _COLUMNS))
        sparse = depth[::step, ::step]
        has_return = np.isfinite(sparse) & (sparse > 0)
        if not has_return.any():
            return "the depth image is empty"
        spec = self._profile.spec(camera)
        body = _Corridor(spec.clear_radius_m, spec.ground_clearance_m + _FLOOR_M, spec.clear_height_m)
        camera = camera.scaled(sparse.shape[1], sparse.shape[0])
        x, y, z = np.moveaxis(np.where(has_return, sparse, 0)[..., None] * _rays(camera), -1, 0)
        up_m = z + camera.height_m
        high = (up_m > body.low_m) & (up_m < body.height_m)
        hits = x[(x > 0) & (x < body.radius_m + self._stop_m) & (np.abs(y) < body.radius_m) & high]
        if len(hits) >= _FEW_POINTS:
            return f"there is an obstacle {hits.min() - body.radius_m:.2f} m in front of the robot"
        share = _share_in_view(camera, body, self._stop_m)
        if share < _IN_VIEW:
            return (
                f"the depth camera sees only {share:.0%} of the way {self._stop_m:g} m ahead; use a longer "
                "--depth-stop, or correct the camera's height and tilt in the profile"
            )
        hidden = (_not_shown(x, section, camera) for section in _sections(camera, body, self._stop_m))
        return next(filter(None, hidden), None)


def _not_shown(x: NDArray[np.float64], section: _Section, camera: CameraModel) -> str | None:
    """Return which part of a section the returns, `x` (H, W) metres ahead, do not show free; None if there is none."""
    rows, columns = section.square_px
    inside = _sums(section.inside, rows, columns)
    shown = _sums(section.inside & (x >= section.x_m), rows, columns) / np.maximum(inside, 1)
    shown[2 * inside < rows * columns] = 1.0
    row, column = np.unravel_index(shown.argmin(), shown.shape)
    if shown[row, column] >= _SHOWN:
        return None
    square = slice(row, row + rows), slice(column, column + columns)
    ray = _rays(camera)[square][section.inside[square]].mean(axis=0)
    _, left_m, up_m = ray * section.x_m / ray[0] + (0.0, 0.0, camera.height_m)
    return (
        f"the depth image does not show whether the way is free: it has too few returns {section.x_m:.2f} m ahead, "
        f"{abs(left_m):.2f} m to the {'left' if left_m > 0 else 'right'} and {up_m:.2f} m above the floor"
    )
