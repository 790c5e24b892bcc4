"""How far the floor is free in each direction, as one depth image shows it.

Owns that a way is seen to be open. Knows no map.
"""

import math

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.navigation.depth_points import are_solid, points_within
from ltvn_core.types import Depth

_BEARING_STEP_RAD = math.radians(2.2)
"""Wider than a pair of pixels, so that every direction has some."""
_EDGE_RAD = math.radians(3.0)
"""So near to the edge of an image nothing is known."""
_RANGE_M = 3.5
"""Farther away a leaf that is seen aslant may be taken for a gap."""
_BEHIND_M = 0.15
"""A place is free if nothing is seen until so far behind it."""
_BEYOND_M = 0.25
"""So far before and behind a way must be free, too."""
_UNDERFOOT_M = 0.3
"""What is so near is where the robot stands."""
_STEP_M = 0.08
"""A way is looked at in places so far apart."""


class FreeView:
    """What one image shows of the floor."""

    def __init__(self, depth: Depth | None, camera: CameraModel) -> None:
        """Look at a depth image; without one nothing is seen."""
        self._half_rad = camera.horizontal_fov_rad / 2
        self._ranges_m = np.zeros(int(2 * self._half_rad / _BEARING_STEP_RAD) + 1)
        """To the nearest solid thing per bearing; `_RANGE_M` where there is none, 0 where nothing is known."""
        if depth is not None:
            seen = points_within(depth, camera, 2 * _RANGE_M)
            columns = self._columns(np.arctan2(seen[:, 1], seen[:, 0]))
            self._ranges_m[columns] = _RANGE_M + _BEHIND_M
            solid = are_solid(seen)
            np.minimum.at(self._ranges_m, columns[solid], np.hypot(seen[solid, 0], seen[solid, 1]))

    def shows_free(self, way: NDArray[np.float64]) -> bool:
        """Tell whether all of a straight way (2, 2), start and end in the robot's frame, is seen to be free.

        The robot has room at its ends, too: what closes a way may stand just behind them.
        """
        along = (way[1] - way[0]) / max(float(np.hypot(*(way[1] - way[0]))), 1e-9)
        start, end = way[0] - _BEYOND_M * along, way[1] + _BEYOND_M * along
        count = max(2, math.ceil(float(np.hypot(*(end - start))) / _STEP_M) + 1)
        places = np.linspace(start, end, count)
        away_m = np.hypot(places[:, 0], places[:, 1])
        places, away_m = places[away_m > _UNDERFOOT_M], away_m[away_m > _UNDERFOOT_M]
        bearings = np.arctan2(places[:, 1], places[:, 0])
        if not len(places) or np.abs(bearings).max() > self._half_rad - _EDGE_RAD or away_m.max() > _RANGE_M:
            return False
        columns = np.clip(self._columns(bearings), 1, len(self._ranges_m) - 2)
        beside_m = self._ranges_m[np.stack([columns - 1, columns, columns + 1])]
        return bool((beside_m >= away_m + _BEHIND_M).all())

    def _columns(self, bearings: NDArray[np.float64]) -> NDArray[np.intp]:
        columns = np.floor((bearings + self._half_rad) / _BEARING_STEP_RAD).astype(np.intp)
        return np.clip(columns, 0, len(self._ranges_m) - 1)
