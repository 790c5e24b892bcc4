"""What speaks for a pose between two images and what against it, as numbers.

Owns the evidence of key points: how many agree, how they are spread, and whether they would agree elsewhere as well.
`geometric_surface` compares depth and colours; `geometric_calibration` weighs all of it.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.predictors.geometric_features import ImageFeatures
from ltvn_core.predictors.geometric_pose import CameraMotion, PointPairs, points
from ltvn_core.predictors.geometric_surface import DEPTH_TOLERANCE, DEPTH_TOLERANCE_M

INLIER_REACH = 0.009
"""A key point agrees with a pose when it is seen so near to where it should be, as a ray."""
_CELLS = 4
"""The image has so many cells along each side when it is counted how far the agreeing key points are spread."""
_RIVALS = 160
"""So many of the strongest key points are asked for other matches,"""
_RIVAL_MARGIN, _RIVAL_MIN = 0.05, 0.75
"""whose cosines are hardly less than the best one's."""
_RIVAL_REACH_M = 0.08
_RIVAL_PAIRS = 300
"""More pairs would not say more."""


class Evidence(NamedTuple):
    """What was counted for one pose; shares are in [0, 1]."""

    agreeing: float
    """Logarithm of one plus the number of key points that agree."""
    agreeing_share: float
    """Of the pairs that descriptors proposed alone, so many agree."""
    repeated_share: float
    """Of the key points that both images should show, so many were found in both."""
    spread: float
    """Share of the image's cells with agreeing key points, in the image where it is less."""
    overlap: float
    """Share of the surface points that lie in the other image, in the image where it is less."""
    depth_agreement: float
    """Of those, so many have the depth that they should have."""
    depth_conflict: float
    """So many stand where the other image looks through."""
    brightness: float
    """Correlation of the brightness of those that agree."""
    colour_conflict: float
    """Of those so many have a colour that is nowhere near in the other image."""
    colour_gap: float
    """Mean difference of the colours of those that agree, of 255, each at most 40."""
    rival: float
    """Support of the best other shift, as where a pattern repeats, over that of this one."""
    tilt_gap: float
    """Radians between the directions of gravity of both images, beyond what is usual."""
    uncertainty: float
    """Logarithm of the standard deviation of the shift in metres."""


NO_EVIDENCE = Evidence(*[0.0] * len(Evidence._fields))
"""Nothing counted yet."""


def agreeing_pairs(motion: CameraMotion, pairs: PointPairs) -> NDArray[np.bool_]:
    """Tell which of P pairs agree with a motion, in rays and in depth, (P,)."""
    return np.logical_or(_seen_there(motion, pairs), _seen_there(motion.inverse(), pairs.swapped()))


def _seen_there(motion: CameraMotion, pairs: PointPairs) -> NDArray[np.bool_]:
    there = motion.apply(points(pairs.first_rays, pairs.first_depth))
    ahead = np.maximum(there[:, 2], 0.05)
    gaps = np.linalg.norm(there[:, :2] / ahead[:, None] - pairs.second_rays, axis=1)
    off = np.abs(ahead - pairs.second_depth)
    fits = (pairs.second_depth == 0) | (off < DEPTH_TOLERANCE_M + DEPTH_TOLERANCE * ahead)
    return (pairs.first_depth > 0) & (there[:, 2] > 0.05) & (gaps < INLIER_REACH) & fits


def spread(rays: NDArray[np.floating], camera: CameraModel) -> float:
    """Return the share of the image's cells in which any of the rays (P, 2) lies."""
    pixels = camera.rays_to_pixels(np.asarray(rays, np.float64))
    cells = np.floor((pixels + 0.5) / np.array([camera.width, camera.height]) * _CELLS)
    cells = np.clip(np.nan_to_num(cells), 0, _CELLS - 1)
    return len(np.unique(cells[:, 0] * _CELLS + cells[:, 1])) / _CELLS**2


def rival_support(
    motion: CameraMotion, first: ImageFeatures, second: ImageFeatures, cosines: NDArray[np.float32]
) -> float:
    """Return how much key points support another shift with the same turn, over their support of the motion's.

    On tiles, or between equal doors, a key point has several matches that are almost as good as its best.
    """
    known = np.flatnonzero(first.depth > 0)[:_RIVALS]
    others = np.flatnonzero(second.depth > 0)
    if len(known) < 2 or len(others) < 5:
        return 0.0
    likely = cosines[known] if len(others) == cosines.shape[1] else cosines[np.ix_(known, others)]
    matched = likely.max(1) > _RIVAL_MIN  # No other key point has anything to offer.
    known, likely = known[matched], likely[matched]
    best = np.argpartition(-likely, 3, axis=1)[:, :4]
    value = np.take_along_axis(likely, best, axis=1)
    good = (value > value.max(1, keepdims=True) - _RIVAL_MARGIN) & (value > _RIVAL_MIN)
    rows, picks = np.nonzero(good)
    a, b = known[rows], others[best[rows, picks]]
    shifts = points(second.rays[b], second.depth[b]) - points(first.rays[a], first.depth[a]) @ motion.rotation.T
    shifts = shifts[:_RIVAL_PAIRS]
    squares = (shifts**2).sum(1)
    near = squares[:, None] + squares - 2 * shifts @ shifts.T < _RIVAL_REACH_M**2
    off = np.linalg.norm(shifts - motion.translation, axis=1)
    own = np.count_nonzero(off < _RIVAL_REACH_M)
    rivals = near.sum(1)[off > 3 * _RIVAL_REACH_M]
    return float(min(rivals.max(initial=0) / max(own, 1), 2.0))
