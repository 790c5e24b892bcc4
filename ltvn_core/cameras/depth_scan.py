"""A planar range scan from a depth image, like that of a lidar: the nearest obstacle at each bearing.

Owns the bins of bearings, and the margins at both sides of an image.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.cameras.depth_points import are_solid, points_within
from ltvn_core.geometry import invert
from ltvn_core.types import Observation, Pose

RANGE_M = 4.0
"""Largest range of a scan in metres."""
_EDGE_RAD = math.radians(3.0)
"""Width of the margin at each side of an image in which a scan is unknown, in radians."""
_BEARING_STEP_RAD = math.radians(1.5)
"""Least width of a bin of bearings, in radians; wider for a camera whose pixels are wider."""
_HOLE = 0.12
"""Height of a gap between the points of a column above which something may be in it, in metres at one metre of depth:
a few pixels without depth are noise; more are glass, something black, or a wall without texture."""
_BELOW_M = 0.2
"""Depth in metres below the floor to which the floor may seem to lie; what lies lower is a reflection."""
FREE_BEYOND_M = 0.3
"""Distance in metres that a scan must reach beyond a place to show that its floor is free."""


class DepthScan(NamedTuple):
    """The range scan of one image."""

    stamp: float
    pose: Pose
    """Odometry pose (3,) of the image."""
    half_rad: float
    """Half the camera's horizontal field of view, in radians."""
    step_rad: float
    """Width of a bin of bearings, in radians."""
    ranges_m: NDArray[np.float64]
    """Ranges (B,) in metres to the nearest obstacle at each bearing, from right to left; `RANGE_M` without obstacle, 0
    if unknown."""
    shown_m: NDArray[np.float64]
    """Ranges (B,) in metres up to which the image shows each bearing free, at most `ranges_m`; 0 if unknown."""
    lens_m: float
    """Height of the camera in metres."""
    lowest_slopes: NDArray[np.float64]
    """Slopes (B,) from the camera to the lowest point at each bearing, in metres a metre; NaN if unknown."""

    @classmethod
    def of(
        cls, camera: CameraModel, stamp: float, pose: Pose, seen: NDArray[np.float64], height_m: float
    ) -> "DepthScan":
        """Return the scan of an image from its points (M, 3) in the robot's frame, for a robot of `height_m`.

        A bearing is shown free up to its farthest point below that height, be it floor or obstacle, as long as the
        points below it leave no hole: nothing is free because nothing was seen there.
        """
        half_rad = camera.horizontal_fov_rad / 2
        step_rad = max(_BEARING_STEP_RAD, 1 / camera.fx)
        count = int(2 * half_rad / step_rad) + 1
        unknown = np.full(count, np.nan)
        scan = cls(stamp, pose, half_rad, step_rad, np.zeros(count), np.zeros(count), camera.height_m, unknown)
        seen = seen[(seen[:, 2] < height_m) & (seen[:, 2] > -_BELOW_M)]
        place = np.clip(scan.bins(np.arctan2(seen[:, 1], seen[:, 0])), 0, count - 1)
        away_m = np.hypot(seen[:, 0], seen[:, 1])
        solid = are_solid(seen, height_m)
        scan.ranges_m[place] = RANGE_M
        np.minimum.at(scan.ranges_m, place[solid], away_m[solid])
        np.fmin.at(scan.lowest_slopes, place, (seen[:, 2] - camera.height_m) / np.maximum(away_m, 1e-6))
        whole = _without_hole(place, (seen[:, 2] - camera.height_m) / np.maximum(seen[:, 0], 1e-6))
        np.maximum.at(scan.shown_m, place[whole], away_m[whole])
        np.minimum(scan.shown_m, scan.ranges_m, out=scan.shown_m)
        return scan

    @classmethod
    def from_image(
        cls, seen: Observation, camera: CameraModel, pose: Pose, *, height_m: float, trusted_m: float = RANGE_M
    ) -> "DepthScan":
        """Return the scan of an image taken at a pose (3,), for a robot of `height_m`; without depth, all ranges are
        unknown.

        A direction in which only points beyond `RANGE_M` are seen is free if they are nearer than `trusted_m`. Cameras
        that fill holes with a large depth make this unsafe for maps.
        """
        points = np.empty((0, 3)) if seen.depth is None else points_within(seen.depth, camera, trusted_m)
        return cls.of(camera, seen.stamp, pose, points, height_m)

    def polar(self, points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return distances (M,) and bearings (M,), seen from the image, of points (M, 2 or 3) in the odometry frame."""
        x, y, yaw = invert(self.pose)
        cos = np.cos(yaw)
        sin = np.sin(yaw)
        ahead = x + cos * points[:, 0] - sin * points[:, 1]
        left = y + sin * points[:, 0] + cos * points[:, 1]
        return np.hypot(ahead, left), np.arctan2(left, ahead)

    def inside(self, bearing: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which bearings (...) are inside the image, without its margins."""
        return np.abs(bearing) < self.half_rad - _EDGE_RAD

    def beside(self, bearing: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the ranges (3, ...) at bearings (...) and in the bins on both sides."""
        return self.ranges_m[self._around(bearing)]

    def shows_past(self, bearing: NDArray[np.float64], away_m: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return whether (...) bearings (...) are shown free beyond distances (...), see `reach_past`."""
        return reach_past(self.shown_m[self._around(bearing)], away_m)

    def seen_above(self, bearing: NDArray[np.float64], away_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the heights (...) above which the image shows what is at bearings (...) and distances (...), because a
        camera sees over a low box right in front of the robot; NaN if unknown."""
        return self.lens_m + np.fmax.reduce(self.lowest_slopes[self._around(bearing)]) * away_m

    def _around(self, bearing: NDArray[np.float64]) -> NDArray[np.intp]:
        place = np.clip(self.bins(bearing), 1, len(self.ranges_m) - 2)
        return np.stack([place - 1, place, place + 1])

    def bins(self, bearing: NDArray[np.float64]) -> NDArray[np.intp]:
        """Return the bin of each bearing (...); it does not exist if the bearing is outside the image."""
        return np.floor((bearing + self.half_rad) / self.step_rad).astype(np.intp)

    def things(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return bearings (K,) in the odometry frame and ranges (K,) of all obstacles, from right to left."""
        seen = np.flatnonzero((self.ranges_m > 0) & (self.ranges_m < RANGE_M))
        return (seen + 0.5) * self.step_rad - self.half_rad + self.pose[2], self.ranges_m[seen]

    def solid_points(self) -> NDArray[np.float64]:
        """Return the positions (K, 2) of all obstacles in the odometry frame."""
        bearings, ranges_m = self.things()
        return self.pose[:2] + ranges_m[:, None] * np.stack([np.cos(bearings), np.sin(bearings)], axis=-1)

    def between(self, first_rad: float, last_rad: float) -> NDArray[np.float64] | None:
        """Return all known ranges (K,) between two bearings; None if the bearings are outside the image or unknown."""
        ends = np.array([first_rad, last_rad])
        if not self.inside(ends).all():
            return None
        first, last = self.bins(ends)
        ranges_m = self.ranges_m[first : last + 1]
        return ranges_m[ranges_m > 0] if ranges_m.any() else None


def _without_hole(place: NDArray[np.intp], slope: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which points (M,) of bearings `place` (M,) have no hole below them; `slope` (M,) is their height seen from
    the camera, at one metre of depth."""
    order = np.lexsort((slope, place))
    first = np.diff(place[order], prepend=-1) > 0
    gap = np.diff(slope[order], prepend=0.0)
    gap[first] = slope[order][first] - slope.min(initial=np.inf)
    holes = np.cumsum(gap > _HOLE)
    before = (holes - (gap > _HOLE))[first]
    whole = np.empty(len(place), np.bool_)
    whole[order] = holes == before[np.cumsum(first) - 1]
    return whole


def reach_past(beside: NDArray[np.float64], away_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return whether (...) the ranges (3, ...) at and beside bearings are all larger than a distance (...).

    One of the three bins may be unknown, because a bin can lie between two columns of pixels; then only the others
    count.
    """
    unknown = beside == 0
    is_past = (unknown | (beside > away_m)).all(axis=0)
    return is_past & (unknown.sum(axis=0) <= 1)
