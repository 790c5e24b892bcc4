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
MIN_SUPPORT = 8
"""Fewer points support no pose."""

_ENOUGH_WITH_DEPTH = 8
"""So many pairs with depth in both images make triangles; with fewer, points of one image meet rays of the other."""
_TRIANGLES = 1200
_MAX_HYPOTHESES = 150
_SHORTEST_SIDE_M = 0.08
_DEPTH_GAP_WEIGHT = 0.2
"""A gap of one over metres counts as so much of a gap between rays."""
_FOCAL = 500.0
"""OpenCV counts in pixels; any focal length serves."""
_NOWHERE = 1e3
"""The ray of a point behind the camera; nothing is near it."""


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

    def take(self, chosen: NDArray[np.bool_] | slice) -> "PointPairs":
        """Return the chosen ones."""
        return PointPairs(*(part[chosen] for part in self))


def points(rays: NDArray[np.floating], depth: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return the points (N, 3) at rays (N, 2) and depths (N,)."""
    ahead = np.asarray(depth, np.float64)
    return np.concatenate([rays * ahead[:, None], ahead[:, None]], axis=1)


def projected(motion: CameraMotion, rays: NDArray[np.float32], depth: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the rays (N, 2) at which the second camera sees points at rays (N, 2) and depths (N,) of the first."""
    there = motion.apply(points(rays, depth))
    ahead = there[:, 2] > 0.05
    rays_there = there[:, :2] / np.where(ahead, there[:, 2], 1)[:, None]
    return np.where(ahead[:, None], rays_there, _NOWHERE).astype(np.float32)


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
    corners_first, corners_second = corners_first[alike], corners_second[alike]
    rotations = _triangle_frames(corners_second) @ _triangle_frames(corners_first).transpose(0, 2, 1)
    shifts = corners_second.mean(1) - (rotations @ corners_first.mean(1)[:, :, None])[:, :, 0]
    seen = rotations.astype(np.float32) @ first.T.astype(np.float32) + shifts[:, :, None].astype(np.float32)
    ahead = np.maximum(seen[:, 2], 0.05)
    gaps = (seen[:, 0] / ahead - known.second_rays[:, 0]) ** 2 + (seen[:, 1] / ahead - known.second_rays[:, 1]) ** 2
    gaps += (_DEPTH_GAP_WEIGHT * (1 / ahead - 1 / known.second_depth)) ** 2
    # The mean of bounded squares (MSAC) prefers the more exact of two poses with equal support.
    cost = np.minimum(gaps, SEARCH_REACH**2).sum(1)
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
