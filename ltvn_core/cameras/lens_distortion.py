"""Lens distortion as OpenCV and ROS define it, between ideal and distorted points. Pure numpy.

A point is (right, down) in metres on the plane one metre before the lens. Owns the two models, Brown-Conrady for
ordinary lenses and Kannala-Brandt for fisheyes, and their inverses. Knows no pixels.
"""

from functools import lru_cache
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Points: TypeAlias = NDArray[np.float64]
"""(..., 2): right and down, at one metre of depth."""

PLUMB_BOB_COUNTS = (0, 4, 5, 8)
"""Coefficients of an ordinary lens: none; k1 k2 p1 p2; then k3; then k4 k5 k6."""
FISHEYE_COUNT = 4
"""Coefficients of a fisheye: k1 k2 k3 k4."""

_WIDEST_RADIUS = 10.0
"""An ordinary lens that does not fold up to here (84 degrees off its axis) never does."""
_ITERATIONS = 30
_TOLERANCE = 1e-8
_DERIVATIVE_STEP = 1e-6


def distort(points: Points, coefficients: tuple[float, ...]) -> Points:
    """Return where an ordinary lens puts ideal points (..., 2); NaN for points beyond what it can see."""
    if not coefficients:
        return points
    beyond = np.hypot(points[..., 0], points[..., 1]) > _largest_radius(coefficients)
    return np.where(beyond[..., None], np.nan, _plumb_bob(points, coefficients))


def _plumb_bob(points: Points, coefficients: tuple[float, ...]) -> Points:
    k1, k2, p1, p2, k3, k4, k5, k6 = (*coefficients, *(0.0,) * (8 - len(coefficients)))
    x, y = points[..., 0], points[..., 1]
    r2 = x * x + y * y
    radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    return np.stack(
        [
            x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
        ],
        axis=-1,
    )


def undistort(points: Points, coefficients: tuple[float, ...]) -> Points:
    """Return the ideal points (..., 2) that an ordinary lens shows at `points`; NaN where there is none."""
    if not coefficients:
        return points
    ideal = points.copy()
    # The polynomial has no inverse in closed form, so Newton's method finds it.
    with np.errstate(all="ignore"):
        for _ in range(_ITERATIONS):
            ideal = ideal - _newton_step(ideal, _plumb_bob(ideal, coefficients) - points, coefficients)
        wrong = ~(np.abs(distort(ideal, coefficients) - points).max(axis=-1) < _TOLERANCE)
    return np.where(wrong[..., None], np.nan, ideal)


def distort_fisheye(points: Points, coefficients: tuple[float, ...]) -> Points:
    """Return where a fisheye puts ideal points (..., 2)."""
    radius = np.maximum(np.hypot(points[..., 0], points[..., 1]), 1e-12)
    return points * (_fisheye_radius(np.arctan(radius), coefficients) / radius)[..., None]


def undistort_fisheye(points: Points, coefficients: tuple[float, ...]) -> Points:
    """Return the ideal points (..., 2) that a fisheye shows at `points`; NaN where it looks sideways or back."""
    radius = np.maximum(np.hypot(points[..., 0], points[..., 1]), 1e-12)
    angle = np.minimum(radius, np.pi / 2)
    gap = np.zeros_like(radius)
    with np.errstate(all="ignore"):
        for _ in range(_ITERATIONS):
            gap = _fisheye_radius(angle, coefficients) - radius
            slope = (_fisheye_radius(angle + _DERIVATIVE_STEP, coefficients) - (gap + radius)) / _DERIVATIVE_STEP
            angle = angle - gap / slope
        found = (np.abs(gap) < _TOLERANCE) & (angle >= 0) & (angle < np.pi / 2)
        scale = np.where(found, np.tan(angle) / radius, np.nan)
    return points * scale[..., None]


@lru_cache(maxsize=32)
def _largest_radius(coefficients: tuple[float, ...]) -> float:
    """Return how far from the axis the polynomial is a lens: beyond, it folds back into the picture."""
    radii = np.linspace(0, _WIDEST_RADIUS, 4001)
    seen = _plumb_bob(
        np.stack([radii, np.zeros_like(radii)], axis=-1), (*coefficients[:2], 0.0, 0.0, *coefficients[4:])
    )
    folds = np.flatnonzero(np.diff(seen[:, 0]) <= 0)
    return float(radii[folds[0]]) if len(folds) else float("inf")


def _newton_step(ideal: Points, error: Points, coefficients: tuple[float, ...]) -> Points:
    """Return how far (..., 2) to go back to make the error smaller."""
    here = _plumb_bob(ideal, coefficients)
    by_x = (_plumb_bob(ideal + np.array([_DERIVATIVE_STEP, 0]), coefficients) - here) / _DERIVATIVE_STEP
    by_y = (_plumb_bob(ideal + np.array([0, _DERIVATIVE_STEP]), coefficients) - here) / _DERIVATIVE_STEP
    determinant = by_x[..., 0] * by_y[..., 1] - by_y[..., 0] * by_x[..., 1]
    right = (by_y[..., 1] * error[..., 0] - by_y[..., 0] * error[..., 1]) / determinant
    down = (by_x[..., 0] * error[..., 1] - by_x[..., 1] * error[..., 0]) / determinant
    return np.stack([right, down], axis=-1)


def _fisheye_radius(angle: NDArray[np.float64], coefficients: tuple[float, ...]) -> NDArray[np.float64]:
    """Return how far from the centre a ray appears that is `angle` off the optical axis."""
    k1, k2, k3, k4 = coefficients
    a2 = angle * angle
    return angle * (1 + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4))))
