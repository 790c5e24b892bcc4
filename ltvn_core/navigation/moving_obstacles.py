"""Which of the points that a depth image shows have moved: those where an image shortly before saw free floor.

Compares images of the last seconds, where odometry puts them. What stood still since before is not moving any more, so
a person who stops becomes an obstacle like others. Decides nothing.
"""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from ltvn_core.navigation.bystanders import Bystanders
from ltvn_core.navigation.depth_scan import FREE_BEYOND_M, DepthScan, bearing_bins

_YOUNGEST_S, _OLDEST_S = 0.3, 3.0
"""An image is compared with those taken so much earlier."""
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

    def __init__(self, bystanders: Bystanders) -> None:
        """Remember nothing yet; `bystanders` are told who moves."""
        self._bystanders = bystanders
        self._scans: deque[DepthScan] = deque(maxlen=24)

    def moving(self, scan: DepthScan, things: NDArray[np.float64], nearby: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return which of the solid points (M, 2) of an image, in the odometry frame, have moved (M,); remember it.

        Where nobody as large as a person moves, only points that are `nearby` (M,) can be somebody.
        """
        moved = self._moved(scan.stamp, things)
        if _are_somebody(things[moved], scan):
            self._bystanders.noticed(scan.stamp)
            placed = np.hypot(*(things - scan.pose[:2]).T) < _PLACED_M
            self._bystanders.look(scan, things[moved & placed])
        else:
            self._bystanders.look(scan, things[moved & nearby])
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
    """Tell whether moving things (M, 2) in the odometry frame are as wide as a person."""
    bearings = bearing_bins(scan.polar(moving)[1], scan.half_rad)
    return len(bearings) >= _SOMEBODY_POINTS and len(np.unique(bearings)) >= _SOMEBODY_BEARINGS


def _votes(scan: DepthScan, points: NDArray[np.float64]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return where (M,) an earlier image saw free floor, and where it saw a thing."""
    away_m, bearing = scan.polar(points)
    inside, beside = scan.inside(bearing), scan.beside(bearing)
    free = inside & (beside > away_m + FREE_BEYOND_M).all(axis=0)
    return free, inside & (np.abs(beside - away_m) < _SAME_PLACE_M).any(axis=0)
