"""The pose that fits all corresponding key points of two images best, and how exactly it is known.

Owns the least squares: Gauss-Newton over the rays in both images and the depths, each weighed by how exactly it is
known, outliers by a Cauchy loss.
"""

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from ltvn_core.predictors.geometric_pose import CameraMotion, PointPairs, points

_ITERATIONS = 8
_MAX_REFINED = 200
"""More pairs make a pose hardly more exact; the strongest key points come first."""
_RAY_SIGMA = 0.004
"""How exactly a key point is seen, as a ray: about a pixel of an image of 320 x 240."""
_INVERSE_DEPTH_SIGMA = 0.02
"""How exactly a depth camera measures one over metres, the alignment of colour and depth included."""


class _Sighting(NamedTuple):
    """Points (N, 3) of one image, and how the other image saw them."""

    points: NDArray[np.float64]
    rays: NDArray[np.float64]
    """(N, 2)"""
    inverse_depth: NDArray[np.float64]
    """(N,): one over metres."""
    depth_weight: NDArray[np.float64]
    """(N,): one over the error of that; 0 where there is no depth."""


def refine_motion(motion: CameraMotion, pairs: PointPairs) -> tuple[CameraMotion, NDArray[np.float64]]:
    """Return the motion that fits all pairs best, outliers aside, and the covariance (6, 6) of turn and shift.

    Gauss-Newton over the rays in both images and the depths, each weighed by how exactly it is known (Cauchy).
    """
    pairs = pairs.take(slice(_MAX_REFINED))
    there, back = _sighting(pairs), _sighting(pairs.swapped())
    by_back = _by_turn_and_shift(back.points)
    normal = np.eye(6)
    for _ in range(_ITERATIONS):
        jacobians, residuals = _residuals(motion, there, back, by_back)
        weights = np.repeat(1 / (1 + (residuals**2).sum(1) / 4), 3)
        rows = jacobians.reshape(-1, 6)
        weighted = (rows * weights[:, None]).T
        normal = weighted @ rows + 1e-6 * np.eye(6)
        step = -np.asarray(np.linalg.solve(normal, weighted @ residuals.ravel()), np.float64)
        motion = _moved(motion, step)
        if np.abs(step).max() < 1e-4:
            break
    return motion, np.asarray(np.linalg.inv(normal), np.float64)


def _sighting(pairs: PointPairs) -> _Sighting:
    """Return the first image's points with depth, and how the second saw them."""
    known = pairs.first_depth > 0
    depth = pairs.second_depth[known]
    return _Sighting(
        points(pairs.first_rays[known], pairs.first_depth[known]),
        pairs.second_rays[known],
        1 / np.maximum(depth, 0.05),
        np.where(depth > 0, 1 / _INVERSE_DEPTH_SIGMA, 0),
    )


def _residuals(
    motion: CameraMotion, there: _Sighting, back: _Sighting, by_back: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return Jacobians (N, 3, 6) by turn and shift after the motion, and residuals (N, 3) in sigmas, both ways.

    `by_back` is how the points of the second image move, (M, 3, 6).
    """
    moved = motion.apply(there.points)
    forward = _ray_residuals(moved, _by_turn_and_shift(moved), there)
    inverse = motion.inverse()
    backward = _ray_residuals(inverse.apply(back.points), -inverse.rotation @ by_back, back)
    return np.concatenate([forward[0], backward[0]]), np.concatenate([forward[1], backward[1]])


def _by_turn_and_shift(places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how points (N, 3) move when the world is turned a little and shifted, (N, 3, 6)."""
    jacobians = np.zeros((len(places), 3, 6))
    x, y, z = places.T
    jacobians[:, 0, 1], jacobians[:, 0, 2] = z, -y
    jacobians[:, 1, 0], jacobians[:, 1, 2] = -z, x
    jacobians[:, 2, 0], jacobians[:, 2, 1] = y, -x
    jacobians[:, [0, 1, 2], [3, 4, 5]] = 1
    return jacobians


def _ray_residuals(
    places: NDArray[np.float64], jacobians: NDArray[np.float64], sighting: _Sighting
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return Jacobians (N, 3, 6) and residuals (N, 3) of points (N, 3) against how they were seen."""
    near = 1 / np.maximum(places[:, 2], 0.05)
    seen = places[:, :2] * near[:, None]
    by_ray = (jacobians[:, :2] - seen[:, :, None] * jacobians[:, 2:]) * (near / _RAY_SIGMA)[:, None, None]
    by_depth = -jacobians[:, 2:] * (near**2 * sighting.depth_weight)[:, None, None]
    residuals = np.concatenate(
        [
            (seen - sighting.rays) / _RAY_SIGMA,
            ((near - sighting.inverse_depth) * sighting.depth_weight)[:, None],
        ],
        axis=1,
    )
    return np.concatenate([by_ray, by_depth], axis=1), residuals


def _moved(motion: CameraMotion, step: NDArray[np.float64]) -> CameraMotion:
    turn = np.asarray(cv2.Rodrigues(step[:3])[0], np.float64)
    return CameraMotion(turn @ motion.rotation, turn @ motion.translation + step[3:])
