"""Which of the points that a depth image shows have moved: those where an image shortly before saw free floor.

Compares images of the last seconds, where odometry puts them. What stood still since before is not moving any more, so
a person who stops becomes an obstacle like others. Decides nothing.
"""

import math
from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.geometry import relative
from ltvn_core.navigation.depth_points import are_solid, points_within, transform_points
from ltvn_core.types import Observation, Pose

_BEARING_STEP_RAD = math.radians(1.5)
_EDGE_RAD = math.radians(3.0)
"""So near to the edge of an image nothing is known."""
_RANGE_M = 4.0
"""Images are compared so far."""
_YOUNGEST_S, _OLDEST_S = 0.3, 3.0
"""An image is compared with those taken so much earlier."""
_FREE_BEYOND_M = 0.3
"""An earlier image saw free floor at a place if it saw nothing until so far behind it."""
_SAME_PLACE_M = 0.2
"""A thing that an earlier image saw so near stands still."""
_SOMEBODY_POINTS, _SOMEBODY_BEARINGS = 16, 4
"""So many points, in so many bearings, are somebody and no pole that fell between two pixels."""


class _Scan(NamedTuple):
    """What one image saw, from above."""

    stamp: float
    pose: Pose
    """(3,) by odometry."""
    ranges_m: NDArray[np.float64]
    """(B,) to the nearest solid thing per bearing; `_RANGE_M` where there is none, 0 where nothing is known."""


class MovingObstacles:
    """Remembers the depth images of the last seconds."""

    def __init__(self, camera: CameraModel) -> None:
        """Compare images of a camera."""
        self._camera = camera
        self._half_rad = camera.horizontal_fov_rad / 2
        self._scans: deque[_Scan] = deque(maxlen=24)
        self.sees_somebody = False
        """Whether the newest image shows something that moves and is as wide as a person, up to 4 m away."""

    def moving(self, observation: Observation, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which points (M, 2) of an image, in the odometry frame, have moved (M,), and remember the image."""
        moved = self._moved(observation.stamp, points)
        self.sees_somebody = False
        if observation.depth is not None:
            seen = points_within(observation.depth, self._camera, _RANGE_M)
            solid = are_solid(seen)
            things = seen[solid, :2]
            has_moved = self._moved(observation.stamp, transform_points(things, observation.odometry))
            bearings = self._bins(np.arctan2(things[:, 1], things[:, 0]))[has_moved]
            self.sees_somebody = len(bearings) >= _SOMEBODY_POINTS and len(np.unique(bearings)) >= _SOMEBODY_BEARINGS
            self._scans.append(_Scan(observation.stamp, observation.odometry, self._ranges(seen, solid)))
        return moved

    def _moved(self, stamp: float, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        free, stood = np.zeros(len(points), bool), np.zeros(len(points), bool)
        for scan in self._scans:
            if _YOUNGEST_S <= stamp - scan.stamp <= _OLDEST_S:
                was_free, was_there = self._votes(scan, points)
                free |= was_free
                stood |= was_there
        return free & ~stood

    def _votes(self, scan: _Scan, points: NDArray[np.float64]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return where (M,) an earlier image saw free floor, and where it saw a thing."""
        places = np.column_stack([points, np.zeros(len(points))])
        ahead, left, _ = relative(scan.pose, places).T
        away_m, bearing = np.hypot(ahead, left), np.arctan2(left, ahead)
        inside = np.abs(bearing) < self._half_rad - _EDGE_RAD
        place = np.clip(self._bins(bearing), 1, len(scan.ranges_m) - 2)
        beside = scan.ranges_m[np.stack([place - 1, place, place + 1])]
        free = inside & (beside > away_m + _FREE_BEYOND_M).all(axis=0)
        return free, inside & (np.abs(beside - away_m) < _SAME_PLACE_M).any(axis=0)

    def _ranges(self, seen: NDArray[np.float64], solid: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Return (B,) how far away the nearest solid one of the points (M, 3) is per bearing, see `_Scan`."""
        place = np.clip(self._bins(np.arctan2(seen[:, 1], seen[:, 0])), 0, self._count - 1)
        ranges_m = np.zeros(self._count)
        ranges_m[place] = _RANGE_M
        np.minimum.at(ranges_m, place[solid], np.hypot(seen[solid, 0], seen[solid, 1]))
        return ranges_m

    @property
    def _count(self) -> int:
        return int(2 * self._half_rad / _BEARING_STEP_RAD) + 1

    def _bins(self, bearing: NDArray[np.float64]) -> NDArray[np.intp]:
        return np.floor((bearing + self._half_rad) / _BEARING_STEP_RAD).astype(np.intp)
