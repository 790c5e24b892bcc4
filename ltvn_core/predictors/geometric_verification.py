"""The full comparison of two images: correspondences, pose, and the evidence for it.

Owns the order of the steps, and gives up early where too little agrees. Says nothing about driving.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.predictors.geometric_evidence import Evidence, agreeing_pairs, spread, surface_agreement
from ltvn_core.predictors.geometric_features import ImageFeatures, ImageGrid
from ltvn_core.predictors.geometric_matching import Correspondences, guided_matches, mutual_matches, similarities
from ltvn_core.predictors.geometric_pose import (
    MIN_SUPPORT,
    CameraMotion,
    PointPairs,
    find_motion,
    points,
    refine_motion,
)
from ltvn_core.types import Waypoint

GUIDED_REACH = 0.03
"""Having a first pose, key points are compared with those that lie so near to where it puts them, as rays."""
_FINAL_REACH = 0.012
_USUAL_TILT_GAP_RAD = 0.05
_MAX_TILT_GAP_RAD = 0.5
_MAX_HEIGHT_GAP_M = 0.5


class VerifiedMotion(NamedTuple):
    """A motion from the first image's camera to the second's, and what speaks for it."""

    motion: CameraMotion
    evidence: Evidence


def verify(first: ImageFeatures, second: ImageFeatures, camera: CameraModel, grid: ImageGrid) -> VerifiedMotion | None:
    """Return the motion between two images, at least one of which has depth; None where nothing speaks for any."""
    cosines = similarities(first, second)
    proposed = _pairs(first, second, mutual_matches(cosines))
    motion = find_motion(proposed)
    if motion is None:
        return None
    motion, _ = refine_motion(motion, proposed)
    for reach in (GUIDED_REACH, _FINAL_REACH):
        gaps = ray_gaps(motion, first, second)
        found = _pairs(first, second, guided_matches(cosines, gaps, reach))
        if len(found.first_depth) < MIN_SUPPORT:
            return None
        motion, covariance = refine_motion(motion, found)
    agreeing = agreeing_pairs(motion, found)
    if np.count_nonzero(agreeing) < MIN_SUPPORT:
        return None
    inliers = found.take(agreeing)
    there = surface_agreement(first, second, motion, camera, grid)
    back = surface_agreement(second, first, motion.inverse(), camera, grid)
    shared = min(_visible_count(motion, first, second, camera), len(second.rays))
    evidence = Evidence(
        agreeing=float(np.log1p(len(inliers.first_depth))),
        agreeing_share=float(agreeing_pairs(motion, proposed).mean()),
        repeated_share=len(inliers.first_depth) / max(shared, len(inliers.first_depth), 1),
        spread=min(spread(inliers.first_rays, camera), spread(inliers.second_rays, camera)),
        overlap=_least(first, second, there.visible, back.visible),
        depth_agreement=_least(first, second, there.agreeing, back.agreeing),
        depth_conflict=max(there.conflicting, back.conflicting),
        brightness=_least(first, second, there.brightness, back.brightness),
        tilt_gap=_tilt_gap(motion, first, second),
        height_gap=_height_gap(motion, first, second, camera),
        uncertainty=float(np.log(max(np.sqrt(np.trace(covariance[3:, 3:])), 1e-4))),
    )
    return VerifiedMotion(motion, evidence)


def waypoint(motion: CameraMotion, first: ImageFeatures, second: ImageFeatures) -> Waypoint:
    """Return the second image's place in the frame of the level robot that took the first, (3,)."""
    back = motion.inverse()
    shift = first.level @ back.translation
    turn = first.level @ back.rotation @ second.level.T
    yaw = np.arctan2(turn[1, 0] - turn[0, 1], turn[0, 0] + turn[1, 1])
    return np.array([shift[0], shift[1], yaw])


def ray_gaps(motion: CameraMotion, first: ImageFeatures, second: ImageFeatures) -> NDArray[np.float32]:
    """Return squared distances (K, L) between where the key points of one image should be and where those of the other

    are, as rays: of the first image's in the second, and where they have no depth, the other way.
    """
    gaps = np.full((len(first.rays), len(second.rays)), np.inf, np.float32)
    known = np.flatnonzero(first.depth)
    gaps[known] = _squared_gaps(_projected(motion, first.rays[known], first.depth[known]), second.rays)
    unknown, other = np.flatnonzero(first.depth == 0), np.flatnonzero(second.depth)
    if len(unknown) and len(other):
        back = _projected(motion.inverse(), second.rays[other], second.depth[other])
        gaps[np.ix_(unknown, other)] = _squared_gaps(back, first.rays[unknown]).T
    return gaps


def _projected(motion: CameraMotion, rays: NDArray[np.float32], depth: NDArray[np.float32]) -> NDArray[np.float32]:
    there = motion.apply(points(rays, depth))
    ahead = np.where(there[:, 2] > 0.05, there[:, 2], np.nan)
    return (there[:, :2] / ahead[:, None]).astype(np.float32)


def _squared_gaps(places: NDArray[np.float32], rays: NDArray[np.float32]) -> NDArray[np.float32]:
    across = places[:, None, 0] - rays[None, :, 0]
    down = places[:, None, 1] - rays[None, :, 1]
    return np.nan_to_num(across * across + down * down, nan=np.inf)


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
    pixels = camera.rays_to_pixels(_projected(way, source.rays[known], source.depth[known]).astype(np.float64))
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


def _height_gap(motion: CameraMotion, first: ImageFeatures, second: ImageFeatures, camera: CameraModel) -> float:
    """Return how much the camera seems to have risen or sunk; a robot's does not, and a carried one's may."""
    if first.has_own_tilt or second.has_own_tilt or camera.height_m == 0:
        return 0.0
    return min(abs(float((first.level @ motion.inverse().translation)[2])), _MAX_HEIGHT_GAP_M)
