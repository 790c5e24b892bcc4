"""How far phones trust their own depth: which levels of confidence are too low for it to be used."""

import numpy as np
from numpy.typing import NDArray

from ltvn_core.types import Depth

_LOWEST_OF_THREE = 0
_LARGEST_OF_THREE = 2
_LOW_PERCENT = 34
"""Confidence is 0, 1, 2 as phones give it, or up to 100; the lowest third counts as no depth."""


def without_low_confidence(depth_m: Depth, levels: NDArray[np.uint8]) -> Depth:
    """Return depth (H, W) that is 0, no return, where its levels of confidence (H, W) are low."""
    is_of_three = levels.max(initial=0) <= _LARGEST_OF_THREE
    is_low = levels <= _LOWEST_OF_THREE if is_of_three else levels < _LOW_PERCENT
    return np.where(is_low, 0, depth_m).astype(np.float32)
