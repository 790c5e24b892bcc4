"""What the network said of pairs of images of a tour, kept while a map is built that comes back to the same ones.

Owns the memory alone. Which pairs are asked is each system's own.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from ltvn_core.geometry import invert
from ltvn_core.types import Waypoint

Reach = Callable[[Sequence[int], Sequence[int]], tuple[NDArray[np.float64], Waypoint]]
"""Returns r (P,) and waypoints (P, 3) from P images of the tour to P others, all by their place in it."""
_PAIRS_AT_ONCE = 512
"""So many pairs are compared at once."""


class RememberedReach:
    """Asks about no pair twice, nor about its way back where the answer holds for both; the answers are the same."""

    def __init__(self, reach: Reach, *, both_directions: bool) -> None:
        """Remember what `reach` says; `both_directions` means that it says the same of a way and the way back."""
        self._reach, self._both = reach, both_directions
        self._known: dict[tuple[int, int], tuple[float, NDArray[np.float64]]] = {}

    def __call__(self, sources: Sequence[int], targets: Sequence[int]) -> tuple[NDArray[np.float64], Waypoint]:
        """Return r (P,) and waypoints (P, 3) of P pairs."""
        pairs = list(zip(sources, targets, strict=True))
        new: dict[tuple[int, int], None] = {}
        for source, target in pairs:
            if (source, target) not in self._known and not (self._both and (target, source) in new):
                new[source, target] = None
        self._ask(list(new))
        answers = [self._known[pair] for pair in pairs]
        return np.array([r for r, _ in answers]), np.array([waypoint for _, waypoint in answers]).reshape(-1, 3)

    def _ask(self, pairs: Sequence[tuple[int, int]]) -> None:
        for first in range(0, len(pairs), _PAIRS_AT_ONCE):
            asked = pairs[first : first + _PAIRS_AT_ONCE]
            reachability, waypoints = self._reach(*zip(*asked, strict=True))
            for pair, r, waypoint, back in zip(asked, reachability, waypoints, invert(waypoints), strict=True):
                self._known[pair] = float(r), waypoint
                if self._both:
                    self._known.setdefault((pair[1], pair[0]), (float(r), back))
