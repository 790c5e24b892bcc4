"""Whether two images with a pose between them show the same surface: in the same place, and of the same colour.

Owns the comparison of the coarse depth images and of their colours.
"""

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.predictors.geometric_features import GRID_STEP_PX, ImageFeatures, ImageGrid
from ltvn_core.predictors.geometric_pose import CameraMotion, points

DEPTH_TOLERANCE, DEPTH_TOLERANCE_M = 0.05, 0.04
"""Depths agree within this share and so many metres."""

_MIN_SURFACE = 30
_SURFACE_STEP = 3
"""Every third point of the coarse depth image is enough, and its rows are not in step with that."""
_COLOUR_TOLERANCE = 30.0
_MAX_COLOUR_GAP = 40.0


class ColourDifference(NamedTuple):
    """How the colours of surfaces differ that should be the same."""

    conflict: float
    """Share of those that differ clearly."""
    gap: float
    """Mean difference."""


class SurfaceAgreement(NamedTuple):
    """How the surface that one image sees fits to the other's depth image."""

    visible: float
    agreeing: float
    conflicting: float
    brightness: float
    colours: ColourDifference


NO_SURFACE = SurfaceAgreement(0.0, 0.0, 0.0, 0.0, ColourDifference(0.0, 0.0))
"""Too little of the surface lies in both images."""


def surface_agreement(
    first: ImageFeatures, second: ImageFeatures, motion: CameraMotion, camera: CameraModel, grid: ImageGrid
) -> SurfaceAgreement:
    """Return how the first image's surface points fit to the second's coarse depth image after a motion."""
    chosen = np.arange(0, len(first.grid_depth), _SURFACE_STEP)
    chosen = chosen[first.grid_depth[chosen] > 0]
    there = motion.apply(points(grid.rays[chosen], first.grid_depth[chosen]))
    places, inside = _grid_places(there, camera, grid)
    if np.count_nonzero(inside) < _MIN_SURFACE:
        return NO_SURFACE
    places, expected, chosen = places[inside], there[inside, 2], chosen[inside]
    seen = second.grid_depth[places]
    known = seen > 0
    tolerance = DEPTH_TOLERANCE_M + DEPTH_TOLERANCE * expected
    agreeing = known & (np.abs(seen - expected) < tolerance)
    conflicting = known & (seen > expected + 2 * tolerance)
    alike = agreeing if known.any() else ~known
    return SurfaceAgreement(
        visible=len(places) * _SURFACE_STEP / len(grid.rays),
        agreeing=float(agreeing.sum() / max(known.sum(), 1)),
        conflicting=float(conflicting.sum() / max(known.sum(), 1)),
        brightness=_correlation(_gray(first.grid_rgb[chosen[alike]]), _gray(second.grid_rgb[places[alike]])),
        colours=_colour_difference(first.grid_rgb[chosen[alike]], second.grid_rgb, places[alike], grid),
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


def _gray(rgb: NDArray[np.uint8]) -> NDArray[np.float64]:
    return rgb.astype(np.float64) @ np.array([0.299, 0.587, 0.114])


def _correlation(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    if len(a) < _MIN_SURFACE:
        return 0.0
    a, b = a - a.mean(), b - b.mean()
    scale = np.sqrt((a @ a) * (b @ b))
    # Two even surfaces have no brightness to compare.
    return float(a @ b / (scale + 25.0 * len(a)))


def _colour_difference(
    colours: NDArray[np.uint8], image: NDArray[np.uint8], places: NDArray[np.intp], grid: ImageGrid
) -> ColourDifference:
    """Return how colours (N, 3) differ from what an image (M, 3) shows at and beside places (N,)."""
    if len(colours) < _MIN_SURFACE:
        return ColourDifference(0.0, 0.0)
    shown = image.reshape(grid.rows, grid.columns, 3)
    around = np.ones((3, 3), np.uint8)
    darkest = cv2.erode(shown, around).reshape(-1, 3)[places].astype(np.float64)
    brightest = cv2.dilate(shown, around).reshape(-1, 3)[places].astype(np.float64)
    # Exposure and white balance may have changed between the images.
    gain = (np.median(image[places], axis=0) + 5) / (np.median(colours, axis=0) + 5)
    expected = np.minimum(colours * gain, 255)
    off = np.maximum(darkest - expected, expected - brightest).max(1).clip(0, _MAX_COLOUR_GAP)
    return ColourDifference(float((off > _COLOUR_TOLERANCE).mean()), float(off.mean()))
