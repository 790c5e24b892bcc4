"""What speaks for a pose between two images and what against it, as numbers.

Owns the evidence: key points that agree, how they are spread, and whether the depth images agree where both show the
same surface. Does not weigh it: `geometric_calibration` does.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.predictors.geometric_features import GRID_STEP_PX, ImageFeatures, ImageGrid
from ltvn_core.predictors.geometric_pose import CameraMotion, PointPairs, points

INLIER_REACH = 0.009
"""A key point agrees with a pose when it is seen so near to where it should be, as a ray."""
DEPTH_TOLERANCE = 0.05
"""Depths agree within this share, and 4 cm."""
_DEPTH_TOLERANCE_M = 0.04
_CELLS = 4
"""The image has so many cells along each side when it is counted how far the agreeing key points are spread."""
_MIN_SURFACE = 30


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
    tilt_gap: float
    """Radians between the directions of gravity of both images, beyond what is usual."""
    height_gap: float
    """Metres between the heights of the camera, where it is mounted on a robot."""
    uncertainty: float
    """Logarithm of the standard deviation of the shift in metres."""


class SurfaceAgreement(NamedTuple):
    """How the surface that one image sees fits to the other's depth image."""

    visible: float
    agreeing: float
    conflicting: float
    brightness: float


def agreeing_pairs(motion: CameraMotion, pairs: PointPairs) -> NDArray[np.bool_]:
    """Tell which of P pairs agree with a motion, in rays and in depth, (P,)."""
    return np.logical_or(_seen_there(motion, pairs), _seen_there(motion.inverse(), pairs.swapped()))


def _seen_there(motion: CameraMotion, pairs: PointPairs) -> NDArray[np.bool_]:
    there = motion.apply(points(pairs.first_rays, pairs.first_depth))
    ahead = np.maximum(there[:, 2], 0.05)
    gaps = np.linalg.norm(there[:, :2] / ahead[:, None] - pairs.second_rays, axis=1)
    off = np.abs(ahead - pairs.second_depth)
    fits = (pairs.second_depth == 0) | (off < _DEPTH_TOLERANCE_M + DEPTH_TOLERANCE * ahead)
    return (pairs.first_depth > 0) & (there[:, 2] > 0.05) & (gaps < INLIER_REACH) & fits


def spread(rays: NDArray[np.floating], camera: CameraModel) -> float:
    """Return the share of the image's cells in which any of the rays (P, 2) lies."""
    pixels = camera.rays_to_pixels(np.asarray(rays, np.float64))
    cells = np.floor((pixels + 0.5) / np.array([camera.width, camera.height]) * _CELLS)
    cells = np.clip(np.nan_to_num(cells), 0, _CELLS - 1)
    return len(np.unique(cells[:, 0] * _CELLS + cells[:, 1])) / _CELLS**2


def surface_agreement(
    first: ImageFeatures, second: ImageFeatures, motion: CameraMotion, camera: CameraModel, grid: ImageGrid
) -> SurfaceAgreement:
    """Return how the first image's surface points fit to the second's coarse depth image after a motion."""
    chosen = np.flatnonzero(first.grid_depth)
    there = motion.apply(points(grid.rays[chosen], first.grid_depth[chosen]))
    places, inside = _grid_places(there, camera, grid)
    if np.count_nonzero(inside) < _MIN_SURFACE:
        return SurfaceAgreement(0.0, 0.0, 0.0, 0.0)
    places, expected, chosen = places[inside], there[inside, 2], chosen[inside]
    seen = second.grid_depth[places]
    known = seen > 0
    tolerance = _DEPTH_TOLERANCE_M + DEPTH_TOLERANCE * expected
    agreeing = known & (np.abs(seen - expected) < tolerance)
    conflicting = known & (seen > expected + 2 * tolerance)
    alike = agreeing if known.any() else ~known
    return SurfaceAgreement(
        visible=len(places) / len(grid.rays),
        agreeing=float(agreeing.sum() / max(known.sum(), 1)),
        conflicting=float(conflicting.sum() / max(known.sum(), 1)),
        brightness=_correlation(first.grid_gray[chosen[alike]], second.grid_gray[places[alike]]),
    )


def _grid_places(
    there: NDArray[np.float64], camera: CameraModel, grid: ImageGrid
) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Return which point of the grid is nearest to points (N, 3), and whether they lie in the image, (N,)."""
    ahead = there[:, 2] > 0.1
    rays = there[:, :2] / np.where(ahead, there[:, 2], 1)[:, None]
    pixels = np.nan_to_num(camera.rays_to_pixels(rays), nan=-1e6)
    columns, rows = np.rint((np.clip(pixels, -1e6, 1e6) - GRID_STEP_PX // 2) / GRID_STEP_PX).astype(np.intp).T
    inside = ahead & (columns >= 0) & (columns < grid.columns) & (rows >= 0) & (rows < grid.rows)
    return np.where(inside, rows * grid.columns + columns, 0), inside


def _correlation(first: NDArray[np.uint8], second: NDArray[np.uint8]) -> float:
    if len(first) < _MIN_SURFACE:
        return 0.0
    a, b = first.astype(np.float64), second.astype(np.float64)
    a, b = a - a.mean(), b - b.mean()
    scale = np.sqrt((a @ a) * (b @ b))
    # Two even surfaces have no brightness to compare.
    return float(a @ b / (scale + 25.0 * len(a)))
