"""Clearances: distances from places around the robot to the nearest remembered obstacle.

Owns which points count as noise, and the margins that avoidance, gap centring and detours keep.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

MAX_NOISE_POINTS = 2
"""Number of stray points that are ignored as noise."""
_TOLERANCE_M = 0.005
NARROW_MARGIN_M = 0.02
"""Clearance kept beside the robot in narrow places, for errors of depth, in metres."""
_FAR_M = 0.5
"""Distance from a place beyond which obstacles are ignored, in metres."""
_SAMPLES = 24


class Clearances:
    """Distances to obstacles, in the robot's frame."""

    def __init__(self, points: NDArray[np.float64]) -> None:
        """Index obstacle points (M, 2)."""
        self._tree = KDTree(points) if len(points) > MAX_NOISE_POINTS else None

    def at(self, places: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (...) distances in metres from places (..., 2) to the nearest obstacle; inf if it is far."""
        if self._tree is None:
            return np.full(places.shape[:-1], np.inf)
        gaps, _ = self._tree.query(places, k=MAX_NOISE_POINTS + 1, distance_upper_bound=_FAR_M)
        return np.asarray(gaps)[..., -1]

    def of_lines(self, starts: NDArray[np.float64], ends: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (C,) clearances in metres of straight lines from (C, 2) to (C, 2), without their start points."""
        share = np.linspace(0, 1, _SAMPLES + 1)[1:, None, None]
        return self.at(starts + share * (ends - starts)).min(axis=0)

    def least_m(self, wanted_m: float) -> float:
        """Return the distance in metres to keep from obstacles: the wanted one, or a little less than the present one.

        A robot that is already too close to an obstacle may move away from it, but not closer.
        """
        return min(wanted_m, float(self.at(np.zeros(2))) - _TOLERANCE_M)
