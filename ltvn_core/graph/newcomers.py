"""Images that enter a part of a map one after the other, and those of them that each other image did not meet yet.

Two images that odometry places far apart never meet, so meeting costs as much as there are images nearby, in a small
map and in a large one. Owns who met whom; which images may be near each other is `graph.odometry_gate`.
"""

import numpy as np
from numpy.typing import NDArray

from ltvn_core.graph.odometry_gate import OdometryGate


class Newcomers:
    """The images in one part of a map, by their rows in the gate."""

    def __init__(self, gate: OdometryGate, waiting: NDArray[np.bool_]) -> None:
        """Start empty; `waiting` (N,) becomes true for each image to which a newcomer may be near, until they meet."""
        self._gate = gate
        self._waiting = waiting
        self._number = np.zeros(len(waiting), np.intp)
        """(N,) 1 for the first newcomer, 2 for the second; 0 for images outside."""
        self._met = np.zeros(len(waiting), np.intp)
        """(N,) number of the last newcomer that each image met, or was too far away from to meet."""
        self._last = 0

    @property
    def are_inside(self) -> NDArray[np.bool_]:
        """Whether each image (N,) is inside."""
        return self._number > 0

    def enter(self, row: int) -> None:
        """Let an image in."""
        self._last += 1
        self._number[row] = self._last
        self._waiting[self._gate.near_rows(row)] = True

    def leave(self, row: int) -> None:
        """Let an image out."""
        self._number[row] = 0

    def met_by(self, row: int) -> NDArray[np.int32]:
        """Return the images (K,) inside, in the order in which they came, that an image meets now for the first time.

        Images that are surely too far away are left out.
        """
        near = self._gate.near_rows(row)
        fresh = near[self._number[near] > self._met[row]]
        self._met[row] = self._last
        self._waiting[row] = False
        return fresh[np.argsort(self._number[fresh])]
