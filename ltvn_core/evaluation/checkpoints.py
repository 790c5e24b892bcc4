"""Checkpoints along the way to a goal, and which of them a robot crossed: how far an episode came that failed.

The measure of VISTA (arXiv 2606.17294). Reads the ground truth; the robot knows nothing of them.
"""

import numpy as np
from numpy.typing import NDArray

from ltvn_core.geometry import lengths_along, points_along
from ltvn_core.simulation.clearance_map import ClearanceMap
from ltvn_core.types import Pose

SPACING_M = 1.0
"""Metres from one checkpoint to the next (ours)."""
CROSSED_M = 0.72
"""A robot that comes nearer than this crosses it: the distance at which the paper has a goal reached."""


class Checkpoints:
    """The checkpoints of one episode."""

    def __init__(self, clearance: ClearanceMap, start: Pose, goal: Pose) -> None:
        """Lay them along the way through the middle of the free space, the last at the goal; none without a way."""
        way = clearance.path(start[:2], goal[:2])
        self._xy = np.empty((0, 2)) if way is None else _each_metre(way)
        self._crossed = np.zeros(len(self._xy), bool)

    def see(self, robot: Pose) -> None:
        """Cross what lies around the exact pose (3,) of the robot."""
        self._crossed |= np.hypot(*(self._xy - robot[:2]).T) < CROSSED_M

    @property
    def count(self) -> int:
        """How many there are."""
        return len(self._xy)

    @property
    def crossed(self) -> int:
        """How many were crossed so far, in whatever order."""
        return int(self._crossed.sum())


def _each_metre(way: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the checkpoints (N, 2) of a way (M, 2), without its start."""
    length_m = lengths_along(way)[-1]
    return points_along(way, np.append(np.arange(SPACING_M, length_m, SPACING_M), length_m))
