"""How a camera moved between two images, from corresponding key points with depth on either side.

Owns the search for a pose (P3P in RANSAC, OpenCV) and its refinement over both images at once. Judges no pose. Points
are counted right, down, ahead of a camera; rays are points at one metre of depth.
"""

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

SEARCH_REACH = 0.012
"""A point may be seen so far from where a pose puts it, as a ray, to support that pose in the search."""
MIN_SUPPORT = 6
"""Fewer points support no pose."""

_ITERATIONS = 8
_RAY_SIGMA = 0.004
"""How exactly a key point is seen, as a ray: about a pixel of an image of 320 x 240."""
_INVERSE_DEPTH_SIGMA = 0.02
"""How exactly a depth camera measures one over metres, the alignment of colour and depth included."""
_ENOUGH_WITH_DEPTH = 8
"""So many pairs with depth in both images make triangles; with fewer, points of one image meet rays of the other."""
_TRIANGLES = 1500
_MAX_HYPOTHESES = 200
_SHORTEST_SIDE_M = 0.08
_DEPTH_GAP_WEIGHT = 0.2
"""A gap of one over metres counts as so much of a gap between rays."""
_FOCAL = 500.0
"""OpenCV counts in pixels; any focal length serves."""


class CameraMotion(NamedTuple):
    """A point X of the first camera is rotation X + translation for the second."""

    rotation: NDArray[np.float64]
    """(3, 3)"""
    translation: NDArray[np.float64]
    """(3,) metres."""

    @property
    def turned_rad(self) -> float:
        """The angle of the rotation, about whatever axis."""
        return float(np.arccos(np.clip((np.trace(self.rotation) - 1) / 2, -1, 1)))

    def inverse(self) -> "CameraMotion":
        """Return the motion the other way."""
        return CameraMotion(self.rotation.T, -self.rotation.T @ self.translation)

    def apply(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return points (N, 3) of the first camera as the second has them."""
        return points @ self.rotation.T + self.translation


class PointPairs(NamedTuple):
    """P points of the world as two images have them; depth 0 where there is none."""

    first_rays: NDArray[np.float64]
    first_depth: NDArray[np.float64]
    second_rays: NDArray[np.float64]
    second_depth: NDArray[np.float64]

    def swapped(self) -> "PointPairs":
        """Return the same points with the images changed over."""
        return PointPairs(self.second_rays, self.second_depth, self.first_rays, self.first_depth)

    def take(self, chosen: NDArray[np.bool_]) -> "PointPairs":
        """Return the chosen ones."""
        return PointPairs(*(part[chosen] for part in self))


def points(rays: NDArray[np.floating], depth: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return the points (N, 3) at rays (N, 2) and depths (N,)."""
    ahead = np.asarray(depth, np.float64)
    return np.concatenate([rays * ahead[:, None], ahead[:, None]], axis=1)


def find_motion(pairs: PointPairs) -> CameraMotion | None:
    """Return the motion that most pairs support; None where too few do."""
    if np.count_nonzero((pairs.first_depth > 0) & (pairs.second_depth > 0)) >= _ENOUGH_WITH_DEPTH:
        return _search_by_depth(pairs)
    if np.count_nonzero(pairs.first_depth) >= np.count_nonzero(pairs.second_depth):
        return _search(pairs)
    found = _search(pairs.swapped())
    return None if found is None else found.inverse()


def _search_by_depth(pairs: PointPairs) -> CameraMotion | None:
    """Return the motion by triangles of three points, which must have equal sides in both images."""
    known = pairs.take((pairs.first_depth > 0) & (pairs.second_depth > 0))
    first, second = points(known.first_rays, known.first_depth), points(known.second_rays, known.second_depth)
    drawn = np.random.default_rng(len(first)).integers(0, len(first), (_TRIANGLES, 3))
    corners_first, corners_second = first[drawn], second[drawn]
    alike = _alike_triangles(corners_first, corners_second)
    if not len(alike):
        return None
    rotations = np.einsum(
        "nij,nkj->nik", _triangle_frames(corners_second[alike]), _triangle_frames(corners_first[alike])
    )
    shifts = corners_second[alike].mean(1) - np.einsum("nij,nj->ni", rotations, corners_first[alike].mean(1))
    seen = np.einsum("nij,kj->nki", rotations, first) + shifts[:, None]
    ahead = np.maximum(seen[..., 2], 0.05)
    gaps = ((seen[..., :2] / ahead[..., None] - known.second_rays) ** 2).sum(2)
    gaps += (_DEPTH_GAP_WEIGHT * (1 / ahead - 1 / known.second_depth)) ** 2
    # The mean of bounded squares (MSAC) prefers the more exact of two poses with equal support.
    cost = np.minimum(gaps / SEARCH_REACH**2, 1).sum(1)
    best = int(cost.argmin())
    if np.count_nonzero(gaps[best] < SEARCH_REACH**2) < MIN_SUPPORT:
        return None
    return CameraMotion(rotations[best], shifts[best])


def _alike_triangles(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return which triangles (N, 3, 3) are of one shape and large enough to tell a direction."""
    sides_first = np.linalg.norm(first - np.roll(first, 1, axis=1), axis=2)
    sides_second = np.linalg.norm(second - np.roll(second, 1, axis=1), axis=2)
    alike = np.abs(sides_first - sides_second) < 0.03 + 0.1 * np.minimum(sides_first, sides_second)
    longest = sides_first.max(1)
    flat = sides_first.sum(1) - longest < 1.03 * longest
    return np.flatnonzero(alike.all(1) & (sides_first.min(1) > _SHORTEST_SIDE_M) & ~flat)[:_MAX_HYPOTHESES]


def _triangle_frames(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the axes (N, 3, 3), as columns, that triangles (N, 3, 3) span."""
    along = corners[:, 1] - corners[:, 0]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    normal = np.cross(along, corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
    return np.stack([along, np.cross(normal, along), normal], axis=2)


def _search(pairs: PointPairs) -> CameraMotion | None:
    """Return the motion by P3P, from the points of the first image and the rays of the second."""
    known = pairs.first_depth > 0
    if np.count_nonzero(known) < MIN_SUPPORT:
        return None
    try:
        found, turn, shift, inliers = cv2.solvePnPRansac(
            points(pairs.first_rays, pairs.first_depth)[known],
            pairs.second_rays[known] * _FOCAL,
            np.diag([_FOCAL, _FOCAL, 1.0]),
            None,
            iterationsCount=300,
            reprojectionError=SEARCH_REACH * _FOCAL,
            confidence=0.999,
            flags=cv2.SOLVEPNP_AP3P,
        )
    except cv2.error:  # Points in one line.
        return None
    if not found or inliers is None or len(inliers) < MIN_SUPPORT:
        return None
    motion = CameraMotion(np.asarray(cv2.Rodrigues(turn)[0], np.float64), np.asarray(shift, np.float64).ravel())
    return motion if np.isfinite(motion.translation).all() else None


def refine_motion(motion: CameraMotion, pairs: PointPairs) -> tuple[CameraMotion, NDArray[np.float64]]:
    """Return the motion that fits all pairs best, outliers aside, and the covariance (6, 6) of turn and shift.

    Gauss-Newton over the rays in both images and the depths, each weighed by how exactly it is known (Cauchy).
    """
    normal = np.eye(6)
    for _ in range(_ITERATIONS):
        jacobians, residuals = _residuals(motion, pairs)
        weights = np.repeat(1 / (1 + (residuals**2).sum(1) / 4), 3)
        rows = jacobians.reshape(-1, 6)
        weighted = (rows * weights[:, None]).T
        normal = weighted @ rows + 1e-6 * np.eye(6)
        step = -np.linalg.solve(normal, weighted @ residuals.ravel())
        motion = _moved(motion, step)
        if np.abs(step).max() < 1e-4:
            break
    return motion, np.linalg.inv(normal)


def _residuals(motion: CameraMotion, pairs: PointPairs) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return Jacobians (N, 3, 6) by turn and shift after the motion, and residuals (N, 3) in sigmas, both ways."""
    ahead = pairs.first_depth > 0
    there = motion.apply(points(pairs.first_rays[ahead], pairs.first_depth[ahead]))
    turn = -_cross(there)
    shift = np.broadcast_to(np.eye(3), turn.shape)
    forward = _ray_residuals(
        there, np.concatenate([turn, shift], axis=2), pairs.second_rays[ahead], pairs.second_depth[ahead]
    )
    back = pairs.second_depth > 0
    seen = points(pairs.second_rays[back], pairs.second_depth[back])
    inverse = motion.inverse()
    turn = np.einsum("ij,njk->nik", inverse.rotation, _cross(seen))
    shift = np.broadcast_to(-inverse.rotation, turn.shape)
    backward = _ray_residuals(
        inverse.apply(seen), np.concatenate([turn, shift], axis=2), pairs.first_rays[back], pairs.first_depth[back]
    )
    return np.concatenate([forward[0], backward[0]]), np.concatenate([forward[1], backward[1]])


def _ray_residuals(
    places: NDArray[np.float64],
    jacobians: NDArray[np.float64],
    rays: NDArray[np.float64],
    depth: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return Jacobians (N, 3, 6) and residuals (N, 3) of points (N, 3) against rays (N, 2) and depths (N,)."""
    near = 1 / np.maximum(places[:, 2], 0.05)
    seen = places[:, :2] * near[:, None]
    by_ray = (jacobians[:, :2] - seen[:, :, None] * jacobians[:, 2:]) * (near / _RAY_SIGMA)[:, None, None]
    has_depth = np.where(depth > 0, 1 / _INVERSE_DEPTH_SIGMA, 0)
    by_depth = -jacobians[:, 2:] * (near**2 * has_depth)[:, None, None]
    residuals = np.concatenate(
        [
            (seen - rays) / _RAY_SIGMA,
            ((near - 1 / np.maximum(depth, 0.05)) * has_depth)[:, None],
        ],
        axis=1,
    )
    return np.concatenate([by_ray, by_depth], axis=1), residuals


def _moved(motion: CameraMotion, step: NDArray[np.float64]) -> CameraMotion:
    turn = np.asarray(cv2.Rodrigues(step[:3])[0], np.float64)
    return CameraMotion(turn @ motion.rotation, turn @ motion.translation + step[3:])


def _cross(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the matrices (N, 3, 3) that take the cross product with vectors (N, 3) from the left."""
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(-1, 3, 3)
