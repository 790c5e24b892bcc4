"""What one depth image saw from above: per bearing how far away the nearest solid thing is.

Owns bearings and their edges. Compares nothing.
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
"""Images are read so far."""
EDGE_RAD = math.radians(3.0)
"""So near to the edge of an image nothing is known."""
_BEARING_STEP_RAD = math.radians(1.5)
FREE_BEYOND_M = 0.3
"""An image saw free floor at a place if it saw nothing until so far behind it."""


class DepthScan(NamedTuple):
    """One image from above."""

    stamp: float
    pose: Pose
    """(3,) by odometry."""
    half_rad: float
    """Half the camera's horizontal field of view."""
    ranges_m: NDArray[np.float64]
    """(B,) to the nearest solid thing per bearing, from the right; `RANGE_M` where there is none, 0 where nothing is
    known."""

    @classmethod
    def of(
        cls, camera: CameraModel, stamp: float, pose: Pose, seen: NDArray[np.float64], solid: NDArray[np.bool_]
    ) -> "DepthScan":
        """Read an image from the points (M, 3) that it shows in the robot's frame, and which of them are solid."""
        half_rad = camera.horizontal_fov_rad / 2
        ranges_m = np.zeros(int(2 * half_rad / _BEARING_STEP_RAD) + 1)
        place = np.clip(bearing_bins(np.arctan2(seen[:, 1], seen[:, 0]), half_rad), 0, len(ranges_m) - 1)
        ranges_m[place] = RANGE_M
        np.minimum.at(ranges_m, place[solid], np.hypot(seen[solid, 0], seen[solid, 1]))
        return cls(stamp, pose, half_rad, ranges_m)

    @classmethod
    def from_image(cls, seen: Observation, camera: CameraModel, pose: Pose) -> "DepthScan":
        """Read an image taken at a pose (3,); one without depth shows nothing."""
        points = np.empty((0, 3)) if seen.depth is None else points_within(seen.depth, camera, RANGE_M)
        return cls.of(camera, seen.stamp, pose, points, are_solid(points))

    def polar(self, points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return how far away (M,) and at which bearings (M,) of the image points (M, 2) of the odometry frame are."""
        x, y, yaw = invert(self.pose)
        cos = np.cos(yaw)
        sin = np.sin(yaw)
        ahead = x + cos * points[:, 0] - sin * points[:, 1]
        left = y + sin * points[:, 0] + cos * points[:, 1]
        return np.hypot(ahead, left), np.arctan2(left, ahead)

    def looks_past(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Tell at which points (M, 2) of the odometry frame nothing stands: the image shows what is behind."""
        away_m, bearing = self.polar(points)
        return self.inside(bearing) & reach_past(self.beside(bearing), away_m + FREE_BEYOND_M)

    def inside(self, bearing: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Tell which bearings (...) the image shows, its edges left out."""
        return np.abs(bearing) < self.half_rad - EDGE_RAD

    def beside(self, bearing: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (3, ...) the ranges at bearings (...) and next to them on both sides."""
        place = np.clip(bearing_bins(bearing, self.half_rad), 1, len(self.ranges_m) - 2)
        return self.ranges_m[np.stack([place - 1, place, place + 1])]

    def things(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return bearings (K,) in the odometry frame and ranges (K,) of the things shown, from right to left."""
        seen = np.flatnonzero((self.ranges_m > 0) & (self.ranges_m < RANGE_M))
        return (seen + 0.5) * _BEARING_STEP_RAD - self.half_rad + self.pose[2], self.ranges_m[seen]

    def solid_points(self) -> NDArray[np.float64]:
        """Return (K, 2) where these things are, in the odometry frame."""
        bearings, ranges_m = self.things()
        return self.pose[:2] + ranges_m[:, None] * np.stack([np.cos(bearings), np.sin(bearings)], axis=-1)

    def between(self, first_rad: float, last_rad: float) -> NDArray[np.float64] | None:
        """Return (K,) all known ranges between two bearings; None where the image does not show all of these."""
        ends = np.array([first_rad, last_rad])
        if not self.inside(ends).all():
            return None
        first, last = bearing_bins(ends, self.half_rad)
        ranges_m = self.ranges_m[first : last + 1]
        return ranges_m[ranges_m > 0] if ranges_m.any() else None


def reach_past(beside: NDArray[np.float64], away_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tell (...) whether the ranges beside bearings (3, ...) end farther away than that (...).

    A bearing between two columns of pixels may show nothing; then those beside it decide.
    """
    unknown = beside == 0
    is_past = (unknown | (beside > away_m)).all(axis=0)
    return is_past & (unknown.sum(axis=0) <= 1)


def bearing_bins(bearing: NDArray[np.float64], half_rad: float) -> NDArray[np.intp]:
    """Return in which place of a scan bearings (...) are."""
    return np.floor((bearing + half_rad) / _BEARING_STEP_RAD).astype(np.intp)
