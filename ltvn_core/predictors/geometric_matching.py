"""Which key points of two images are one point of the world: by their descriptors, or near where a pose puts them.

Owns the correspondences. Estimates no pose.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ltvn_core.predictors.geometric_features import ImageFeatures
from ltvn_core.predictors.geometric_pose import CameraMotion, projected

RATIO = 0.85
"""The best match must be closer than this share of the second best (D. Lowe, IJCV 2004)."""
GUIDED_MIN_SIMILARITY = 0.75
"""Cosine that two descriptors need where the pose already says that they should match."""


class Correspondences(NamedTuple):
    """P pairs of key points."""

    first: NDArray[np.intp]
    """(P,): which of the first image's key points."""
    second: NDArray[np.intp]
    """(P,)"""


def similarities(first: ImageFeatures, second: ImageFeatures) -> NDArray[np.float32]:
    """Return the cosines (K, L) between all descriptors of two images."""
    scale = np.float32(1 / 255**2)
    cosines = (first.descriptors.astype(np.float32) * scale) @ second.descriptors.astype(np.float32).T
    return cosines.astype(np.float32, copy=False)


def mutual_matches(cosines: NDArray[np.float32]) -> Correspondences:
    """Return the pairs that are each other's best by cosines (K, L), and clearly better than the second best."""
    if min(cosines.shape) < 2:
        return Correspondences(np.zeros(0, np.intp), np.zeros(0, np.intp))
    best = cosines.argmax(1)
    first = np.flatnonzero(cosines.argmax(0)[best] == np.arange(len(best)))
    second = best[first]
    rows = cosines[first]
    top = rows[np.arange(len(first)), second].copy()
    rows[np.arange(len(first)), second] = -1
    # Distances of unit vectors: |a - b|^2 = 2 - 2 a.b
    clear = (1 - top) < RATIO**2 * (1 - rows.max(1, initial=-1))
    return Correspondences(first[clear], second[clear])


def guided_matches(cosines: NDArray[np.float32], gaps: NDArray[np.float32], reach: float) -> Correspondences:
    """Return the pairs that are each other's best among those whose places differ by less than `reach`.

    Args:
        cosines: (K, L) of descriptors.
        gaps: (K, L) squared distances between where a pose puts the first and where the second are.
        reach: In the unit of the gaps' roots.
    """
    if not cosines.size:
        return Correspondences(np.zeros(0, np.intp), np.zeros(0, np.intp))
    likely = np.where(gaps < reach**2, cosines, 0)
    best = likely.argmax(1)
    first = np.flatnonzero(likely.argmax(0)[best] == np.arange(len(best)))
    second = best[first]
    enough = likely[first, second] > GUIDED_MIN_SIMILARITY
    return Correspondences(first[enough], second[enough])


def ray_gaps(motion: CameraMotion, first: ImageFeatures, second: ImageFeatures) -> NDArray[np.float32]:
    """Return the squared distances (K, L), as rays, of where key points should be to where the others are.

    The first image's are looked for in the second, and where they have no depth, the other way.
    """
    known = np.flatnonzero(first.depth)
    if len(known) == len(first.rays):
        return _squared_gaps(projected(motion, first.rays, first.depth), second.rays)
    gaps = np.full((len(first.rays), len(second.rays)), np.inf, np.float32)
    gaps[known] = _squared_gaps(projected(motion, first.rays[known], first.depth[known]), second.rays)
    unknown, other = np.flatnonzero(first.depth == 0), np.flatnonzero(second.depth)
    if len(unknown) and len(other):
        back = projected(motion.inverse(), second.rays[other], second.depth[other])
        gaps[np.ix_(unknown, other)] = _squared_gaps(back, first.rays[unknown]).T
    return gaps


def _squared_gaps(places: NDArray[np.float32], rays: NDArray[np.float32]) -> NDArray[np.float32]:
    across = places[:, None, 0] - rays[None, :, 0]
    down = places[:, None, 1] - rays[None, :, 1]
    across *= across
    down *= down
    across += down
    return across
