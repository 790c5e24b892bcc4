"""Whether pictures confirm a wheel slip: the images before and after it must agree better once it is mended.

Depth alone may be aligned by a motion that never was, as along a plain wall or by a camera that tilts. The predictor
measures the motion from the whole images, and between several pairs across the step. Owns this check (ours).
"""

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ltvn_core.geometry import compose, distance, relative
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.wheel_slips import Slip
from ltvn_core.types import Observation

_BESIDE = 4
"""Number of images on each side of a slip that are compared with those on the other side."""
_RECOGNISED = 0.5
"""Value of r above which two images count as recognised."""
_LEAST_PAIRS = 3
"""Least number of recognised pairs for a verdict; with fewer, odometry is left alone."""
_LEAST_SHARE = 2 / 3
"""Share of these pairs that must agree better with the mended odometry."""


class SlipCheck:
    """Compares the images around slips."""

    def __init__(self, matcher: Matcher) -> None:
        """Compare through `matcher`, whose keyframes contain the drive."""
        self._matcher = matcher
        self.errors: list[NDArray[np.float64]] = []
        """For each confirmed slip, the (P, 3) errors of the mended odometry by the pairs across it."""

    def confirms(self, drive: Sequence[Observation], slip: Slip, around: tuple[int, int]) -> bool:
        """Tell whether the images of a drive, from the first to the last row `around` a slip, agree better after it is
        mended."""
        first, last = around
        before = drive[max(first, slip.row - _BESIDE) : slip.row]
        after = drive[slip.row : min(last, slip.row + _BESIDE - 1) + 1]
        pairs = [*itertools.product(before, after)]
        features = self._matcher.keyframes.features
        reachability, waypoints = self._matcher.match_pairs(
            features([one.step for one, _ in pairs]), features([other.step for _, other in pairs])
        )
        seen = reachability > _RECOGNISED
        if seen.sum() < _LEAST_PAIRS:
            return False
        there = relative(np.array([one.odometry for one, _ in pairs]), before[-1].odometry)
        onward = relative(after[0].odometry, np.array([other.odometry for _, other in pairs]))
        by_odometry, mended = (
            relative(compose(compose(there, moved), onward), waypoints)[seen] for moved in (slip.moved, slip.truly)
        )
        before_d, after_d = distance(by_odometry), distance(mended)
        if (after_d < before_d).mean() < _LEAST_SHARE or np.median(after_d) >= np.median(before_d):
            return False
        self.errors.append(mended)
        return True
