"""Lens distortion as OpenCV and ROS define it, between ideal and distorted points.

A point is (right, down) in metres on the plane one metre before the lens. OpenCV does the mathematics: Brown-Conrady
for ordinary lenses, Kannala-Brandt for fisheyes. Owns how far a lens sees at all: beyond that the polynomial folds
back, and OpenCV would go on.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import TypeAlias

import cv2
import numpy as np
from cv2.typing import MatLike
from numpy.typing import NDArray

Points: TypeAlias = NDArray[np.float64]
"""(..., 2): right and down, at one metre of depth."""

PLUMB_BOB_COUNTS = (0, 4, 5, 8)
"""Coefficients of an ordinary lens: none; k1 k2 p1 p2; then k3; then k4 k5 k6."""
FISHEYE_COUNT = 4
"""Coefficients of a fisheye: k1 k2 k3 k4."""

_WIDEST_RADIUS = 10.0
"""An ordinary lens that does not fold up to here (84 degrees off its axis) never does."""
_TOLERANCE = 1e-8
_CRITERIA = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12)
_NO_CAMERA = np.eye(3)
"""Points are on the plane one metre before the lens already."""


def distort(points: Points, coefficients: tuple[float, ...]) -> Points:
    """Return where an ordinary lens puts ideal points (..., 2); NaN for points beyond what it can see."""
    if not coefficients:
        return points
    beyond = np.hypot(points[..., 0], points[..., 1]) > _largest_radius(coefficients)
    return np.where(beyond[..., None], np.nan, _plumb_bob(points, coefficients))


def _plumb_bob(points: Points, coefficients: tuple[float, ...]) -> Points:
    still = np.zeros(3)

    def seen(flat: Points) -> MatLike:
        rays = np.concatenate([flat, np.ones_like(flat[..., :1])], axis=-1)
        return cv2.projectPoints(rays, still, still, _NO_CAMERA, np.array(coefficients))[0]

    return _for_all(points, seen)


def undistort(points: Points, coefficients: tuple[float, ...]) -> Points:
    """Return the ideal points (..., 2) that an ordinary lens shows at `points`; NaN where there is none."""
    if not coefficients:
        return points
    known = np.array(coefficients)
    ideal = _for_all(points, lambda flat: cv2.undistortPoints(flat, _NO_CAMERA, known, criteria=_CRITERIA))
    # Beyond the lens's own range the search ends somewhere, and only going back shows that it is nowhere.
    missed = ~(np.abs(distort(ideal, coefficients) - points).max(axis=-1) < _TOLERANCE)
    return np.where(missed[..., None], np.nan, ideal)


def distort_fisheye(points: Points, coefficients: tuple[float, ...]) -> Points:
    """Return where a fisheye puts ideal points (..., 2)."""
    return _for_all(points, lambda flat: cv2.fisheye.distortPoints(flat, _NO_CAMERA, np.array(coefficients)))


def undistort_fisheye(points: Points, coefficients: tuple[float, ...]) -> Points:
    """Return the ideal points (..., 2) that a fisheye shows at `points`; NaN where it looks sideways or back."""
    known = np.array(coefficients)
    ideal = _for_all(points, lambda flat: cv2.fisheye.undistortPoints(flat, _NO_CAMERA, known, criteria=_CRITERIA))
    missed = ~(np.abs(distort_fisheye(ideal, coefficients) - points).max(axis=-1) < _TOLERANCE)
    return np.where(missed[..., None], np.nan, ideal)


def _for_all(points: Points, function: Callable[[Points], MatLike]) -> Points:
    """Return points (..., 2) after an OpenCV function of (N, 1, 2), which has no answer for no points."""
    if not points.size:
        return points
    found = function(np.ascontiguousarray(points.reshape(-1, 1, 2)))
    return np.asarray(found, np.float64).reshape(points.shape)


@lru_cache(maxsize=32)
def _largest_radius(coefficients: tuple[float, ...]) -> float:
    """Return how far from the axis the polynomial is a lens: beyond, it folds back into the picture."""
    radii = np.linspace(0, _WIDEST_RADIUS, 4001)
    seen = _plumb_bob(
        np.stack([radii, np.zeros_like(radii)], axis=-1), (*coefficients[:2], 0.0, 0.0, *coefficients[4:])
    )
    folds = np.flatnonzero(np.diff(seen[:, 0]) <= 0)
    return float(radii[folds[0]]) if len(folds) else float("inf")
