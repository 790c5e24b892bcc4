"""Which of the points that a depth image shows have moved: those where an image shortly before saw free floor.

Compares images of the last seconds, where odometry puts them. What stood still since before is not moving any more, so
a person who stops becomes an obstacle like others. Decides nothing.
"""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.geometry import invert
from ltvn_core.navigation.bystanders import Bystanders
from ltvn_core.navigation.depth_points import are_solid, depths_within, points_within, transform_points
from ltvn_core.navigation.depth_scan import RANGE_M, DepthScan, bearing_bins
from ltvn_core.types import Observation

_YOUNGEST_S, _OLDEST_S = 0.3, 3.0
"""An image is compared with those taken so much earlier."""
_FREE_BEYOND_M = 0.3
"""An earlier image saw free floor at a place if it saw nothing until so far behind it."""
_SAME_PLACE_M = 0.2
"""A thing that an earlier image saw so near stands still."""
MOVING_POINTS = 8
"""So many moving points close by are somebody."""
_SOMEBODY_POINTS, _SOMEBODY_BEARINGS = 16, 4
"""Farther away so many, in so many bearings, are somebody and no pole that fell between two pixels."""
_PLACED_M = 2.5
"""Who moves farther away is noticed, but not placed."""


class MovingObstacles:
    """Remembers the depth images of the last seconds."""

    def __init__(self, camera: CameraModel, bystanders: Bystanders) -> None:
        """Compare images of a camera; `bystanders` are told who moves."""
        self._camera = camera
        self._bystanders = bystanders
        self._scans: deque[DepthScan] = deque(maxlen=24)

    def moving(self, observation: Observation, points: NDArray[np.float64], range_m: float) -> NDArray[np.bool_]:
        """Return which of the `obstacle_points` within a range have moved (M,), and remember the image.

        The points (M, 2) are given in the odometry frame.
        """
        if observation.depth is None:
            return np.zeros(len(points), bool)
        seen = points_within(observation.depth, self._camera, RANGE_M)
        solid = are_solid(seen)
        scan = DepthScan.of(self._camera, observation.stamp, observation.odometry, seen, solid)
        things = seen[solid, :2]
        have_moved = self._moved(observation.stamp, transform_points(things, observation.odometry))
        moved = have_moved[depths_within(observation.depth, RANGE_M)[solid] < range_m]
        things = things[have_moved]
        if _are_somebody(things, scan):
            self._bystanders.noticed(observation.stamp)
            near = np.hypot(*things.T) < _PLACED_M
            self._bystanders.look(scan, transform_points(things[near], observation.odometry))
        else:
            self._bystanders.look(scan, points[moved])
        self._scans.append(scan)
        return moved

    def _moved(self, stamp: float, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        free = np.zeros(len(points), bool)
        asked = np.arange(len(points))
        for scan in reversed(self._scans):
            if not len(asked):
                break
            if _YOUNGEST_S <= stamp - scan.stamp <= _OLDEST_S:
                was_free, was_there = _votes(scan, points[asked])
                free[asked] |= was_free
                free[asked[was_there]] = False
                asked = asked[~was_there]  # What stood still is not moving, whatever older images saw.
        return free


def _are_somebody(moving: NDArray[np.float64], scan: DepthScan) -> bool:
    """Tell whether moving things (M, 2) in the robot's frame are as wide as a person."""
    bearings = bearing_bins(np.arctan2(moving[:, 1], moving[:, 0]), scan.half_rad)
    return len(bearings) >= _SOMEBODY_POINTS and len(np.unique(bearings)) >= _SOMEBODY_BEARINGS


def _votes(scan: DepthScan, points: NDArray[np.float64]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return where (M,) an earlier image saw free floor, and where it saw a thing."""
    x, y, yaw = invert(scan.pose)
    cos, sin = np.cos(yaw), np.sin(yaw)
    ahead, left = x + cos * points[:, 0] - sin * points[:, 1], y + sin * points[:, 0] + cos * points[:, 1]
    away_m, bearing = np.hypot(ahead, left), np.arctan2(left, ahead)
    inside, beside = scan.inside(bearing), scan.beside(bearing)
    free = inside & (beside > away_m + _FREE_BEYOND_M).all(axis=0)
    return free, inside & (np.abs(beside - away_m) < _SAME_PLACE_M).any(axis=0)
