"""The full comparison of two images: correspondences, pose, and the evidence for it (geometric verification).

Owns the matching of key points, by descriptors alone or guided by a pose, and the order of the steps; stops early if
too few key points agree. Does not decide about driving.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.predictors.geometric_evidence import (
    NO_EVIDENCE,
    Evidence,
    agreeing_pairs,
    rival_support,
    spread,
    surface_agreement,
)
from ltvn_core.predictors.geometric_features import ImageFeatures, ImageGrid
from ltvn_core.predictors.geometric_pose import (
    MIN_SUPPORT,
    CameraMotion,
    PointPairs,
    epipolar_motion,
    find_motion,
    projected,
    refine_motion,
)
from ltvn_core.types import Waypoint

RATIO = 0.85
"""Ratio test: the best match must be closer than this share of the second best (D. Lowe, IJCV 2004)."""
GUIDED_MIN_SIMILARITY = 0.75
"""Least cosine of two descriptors in guided matching, where the pose already predicts their positions."""


class Correspondences(NamedTuple):
    """P matched pairs of key points."""

    first: NDArray[np.intp]
    """(P,) key points of the first image."""
    second: NDArray[np.intp]
    """(P,) key points of the second image."""


def similarities(first: ImageFeatures, second: ImageFeatures) -> NDArray[np.float32]:
    """Return the cosines (K, L) between all descriptors of two images."""
    scale = np.float32(1 / 255**2)
    cosines = (first.descriptors.astype(np.float32) * scale) @ second.descriptors.astype(np.float32).T
    return cosines.astype(np.float32, copy=False)


def mutual_matches(cosines: NDArray[np.float32]) -> Correspondences:
    """Return the mutual best matches by cosines (K, L) that are clearly better than the second best."""
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
    """Return the mutual best matches among the pairs closer than `reach` to their predicted positions.

    Args:
        cosines: (K, L) cosines of descriptors.
        gaps: (K, L) squared distances of the second key points from the predicted positions of the first.
        reach: Largest distance, in the unit of the gaps' square roots.
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
    """Return the squared distances (K, L), as rays, of key points from their positions predicted by a motion.

    Key points of the first image with depth are projected into the second. For those without depth, the second image's
    key points are projected into the first.
    """
    known = np.flatnonzero(first.depth)
    if len(known) == len(first.rays):
        return _squared_gaps(projected(motion, first.rays, first.depth), second.rays)
    gaps = np.full((len(first.rays), len(second.rays)), np.inf, np.float32)
    gaps[known] = _squared_gaps(projected(motion, first.rays[known], first.depth[known]), second.rays)
    unknown = np.flatnonzero(first.depth == 0)
    other = np.flatnonzero(second.depth)
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


GUIDED_REACH = 0.02
"""Largest distance, as rays, of a guided match from its predicted position."""
_USUAL_TILT_GAP_RAD = 0.05
_MAX_TILT_GAP_RAD = 0.5


class VerifiedMotion(NamedTuple):
    """A motion from the first image's camera to the second's, and the evidence for it."""

    motion: CameraMotion
    evidence: Evidence


def verify(first: ImageFeatures, second: ImageFeatures, camera: CameraModel, grid: ImageGrid) -> VerifiedMotion | None:
    """Return the motion between two images; None if too few key points support one."""
    cosines = similarities(first, second)
    proposed = _pairs(first, second, mutual_matches(cosines))
    if not (first.has_depth or second.has_depth):
        return _verified_without_depth(first, second, proposed, camera, grid)
    motion = find_motion(proposed)
    found = None if motion is None else _with_guided_matches(motion, first, second, cosines)
    if found is None:
        return None
    measured = _from_key_points(found, proposed, first, second, camera)._replace(
        rival=rival_support(found.motion, first, second, cosines),
        **_from_surfaces(found.motion, first, second, camera, grid),
    )
    return VerifiedMotion(found.motion, measured)


class _GuidedMotion(NamedTuple):
    """A motion with the pairs that agree with it, and its covariance (6, 6)."""

    motion: CameraMotion
    agreeing: PointPairs
    covariance: NDArray[np.float64]


def _with_guided_matches(
    motion: CameraMotion, first: ImageFeatures, second: ImageFeatures, cosines: NDArray[np.float32]
) -> _GuidedMotion | None:
    """Refine a motion with guided matches; None if too few agree."""
    found = _pairs(first, second, guided_matches(cosines, ray_gaps(motion, first, second), GUIDED_REACH))
    if len(found.first_depth) < MIN_SUPPORT:
        return None
    motion, covariance = refine_motion(motion, found)
    agreeing = agreeing_pairs(motion, found)
    if np.count_nonzero(agreeing) < MIN_SUPPORT:
        return None
    return _GuidedMotion(motion, found.take(agreeing), covariance)


def _from_key_points(
    found: _GuidedMotion, proposed: PointPairs, first: ImageFeatures, second: ImageFeatures, camera: CameraModel
) -> Evidence:
    count = len(found.agreeing.first_depth)
    shared = min(_visible_count(found.motion, first, second, camera), len(second.rays))
    return NO_EVIDENCE._replace(
        agreeing=float(np.log1p(count)),
        agreeing_share=float(agreeing_pairs(found.motion, proposed).mean()),
        repeated_share=count / max(shared, count),
        spread=min(spread(found.agreeing.first_rays, camera), spread(found.agreeing.second_rays, camera)),
        tilt_gap=_tilt_gap(found.motion, first, second),
        uncertainty=float(np.log(max(np.sqrt(np.trace(found.covariance[3:, 3:])), 1e-4))),
    )


def _from_surfaces(
    motion: CameraMotion, first: ImageFeatures, second: ImageFeatures, camera: CameraModel, grid: ImageGrid
) -> dict[str, float]:
    """Return the evidence of the surfaces of both images, by the names in `Evidence`."""
    there = surface_agreement(first, second, motion, camera, grid)
    back = surface_agreement(second, first, motion.inverse(), camera, grid)
    return {
        "overlap": _least(first, second, there.visible, back.visible),
        "depth_agreement": _least(first, second, there.agreeing, back.agreeing),
        "depth_conflict": max(there.conflicting, back.conflicting),
        "brightness": _least(first, second, there.brightness, back.brightness),
        "colour_conflict": max(there.colours.conflict, back.colours.conflict),
        "colour_gap": max(there.colours.gap, back.colours.gap),
    }


def _verified_without_depth(
    first: ImageFeatures, second: ImageFeatures, proposed: PointPairs, camera: CameraModel, grid: ImageGrid
) -> VerifiedMotion | None:
    found = epipolar_motion(proposed.first_rays, proposed.second_rays, grid.pixel_ray)
    if found is None:
        return None
    inliers = proposed.take(found.agreeing)
    count = len(inliers.first_depth)
    evidence = NO_EVIDENCE._replace(
        agreeing=float(np.log1p(count)),
        agreeing_share=float(found.agreeing.mean()),
        repeated_share=count / max(min(len(first.rays), len(second.rays)), 1),
        spread=min(spread(inliers.first_rays, camera), spread(inliers.second_rays, camera)),
        tilt_gap=_tilt_gap(found.motion, first, second),
    )
    return VerifiedMotion(found.motion, evidence)


def waypoint(motion: CameraMotion, first: ImageFeatures, second: ImageFeatures) -> Waypoint:
    """Return the waypoint (3,) to the second image, in the frame of the level robot that took the first."""
    back = motion.inverse()
    shift = first.level @ back.translation
    turn = first.level @ back.rotation @ second.level.T
    yaw = np.arctan2(turn[1, 0] - turn[0, 1], turn[0, 0] + turn[1, 1])
    return np.array([shift[0], shift[1], yaw])


def _pairs(first: ImageFeatures, second: ImageFeatures, matches: Correspondences) -> PointPairs:
    return PointPairs(
        first.rays[matches.first].astype(np.float64),
        first.depth[matches.first].astype(np.float64),
        second.rays[matches.second].astype(np.float64),
        second.depth[matches.second].astype(np.float64),
    )


def _visible_count(motion: CameraMotion, first: ImageFeatures, second: ImageFeatures, camera: CameraModel) -> int:
    """Return the number of the first image's key points that the second image should show."""
    source, way = (first, motion) if first.depth.any() else (second, motion.inverse())
    known = source.depth > 0
    pixels = camera.rays_to_pixels(projected(way, source.rays[known], source.depth[known]).astype(np.float64))
    with np.errstate(invalid="ignore"):
        inside = (pixels > 0).all(1) & (pixels < np.array([camera.width - 1, camera.height - 1])).all(1)
    return int(inside.sum())


def _least(first: ImageFeatures, second: ImageFeatures, there: float, back: float) -> float:
    """Return the lesser of two shares; only one is known if only one image has depth."""
    return min([there] * first.has_depth + [back] * second.has_depth, default=0.0)


def _tilt_gap(motion: CameraMotion, first: ImageFeatures, second: ImageFeatures) -> float:
    turn = first.level @ motion.rotation.T @ second.level.T
    gap = float(np.arccos(np.clip(turn[2, 2], -1, 1)))
    return min(max(gap - _USUAL_TILT_GAP_RAD, 0.0), _MAX_TILT_GAP_RAD)
