"""The full comparison of two images: correspondences, pose, and the evidence for it.

Owns the order of the steps, and gives up early where too little agrees. Says nothing about driving.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.predictors.geometric_epipolar import epipolar_motion
from ltvn_core.predictors.geometric_evidence import (
    NO_EVIDENCE,
    Evidence,
    agreeing_pairs,
    rival_support,
    spread,
)
from ltvn_core.predictors.geometric_features import ImageFeatures, ImageGrid
from ltvn_core.predictors.geometric_matching import (
    Correspondences,
    guided_matches,
    mutual_matches,
    ray_gaps,
    similarities,
)
from ltvn_core.predictors.geometric_pose import (
    MIN_SUPPORT,
    CameraMotion,
    PointPairs,
    find_motion,
    projected,
)
from ltvn_core.predictors.geometric_refinement import refine_motion
from ltvn_core.predictors.geometric_surface import surface_agreement
from ltvn_core.types import Waypoint

GUIDED_REACH = 0.02
"""Having a first pose, key points are compared with those that lie so near to where it puts them, as rays."""
_USUAL_TILT_GAP_RAD = 0.05
_MAX_TILT_GAP_RAD = 0.5


class VerifiedMotion(NamedTuple):
    """A motion from the first image's camera to the second's, and what speaks for it."""

    motion: CameraMotion
    evidence: Evidence


def verify(first: ImageFeatures, second: ImageFeatures, camera: CameraModel, grid: ImageGrid) -> VerifiedMotion | None:
    """Return the motion between two images; None where nothing speaks for any."""
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
    """Return the motion by the matches that it helps to find itself; None where too few agree."""
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
    """Return what the surfaces of both images say, by the names in `Evidence`."""
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
    """Return the second image's place in the frame of the level robot that took the first, (3,)."""
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
    """Return how many of the first image's key points the second should show."""
    source, way = (first, motion) if first.depth.any() else (second, motion.inverse())
    known = source.depth > 0
    pixels = camera.rays_to_pixels(projected(way, source.rays[known], source.depth[known]).astype(np.float64))
    with np.errstate(invalid="ignore"):
        inside = (pixels > 0).all(1) & (pixels < np.array([camera.width - 1, camera.height - 1])).all(1)
    return int(inside.sum())


def _least(first: ImageFeatures, second: ImageFeatures, there: float, back: float) -> float:
    """Return the lesser of two shares, of which one is known where only one image has depth."""
    return min([there] * first.has_depth + [back] * second.has_depth, default=0.0)


def _tilt_gap(motion: CameraMotion, first: ImageFeatures, second: ImageFeatures) -> float:
    turn = first.level @ motion.rotation.T @ second.level.T
    gap = float(np.arccos(np.clip(turn[2, 2], -1, 1)))
    return min(max(gap - _USUAL_TILT_GAP_RAD, 0.0), _MAX_TILT_GAP_RAD)
