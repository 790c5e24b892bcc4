"""Estimates the motion of a camera between two images from corresponding key points.

Owns the search for a pose with depth in at least one image (P3P in RANSAC, OpenCV), its refinement over both images
(Gauss-Newton on rays and depths, with a Cauchy loss against outliers), and the search without depth (epipolar geometry,
OpenCV). Two images without depth do not determine the length of the motion; it is guessed from the usual depth of
rooms. Does not verify poses. Coordinates are right, down and ahead of a camera; rays are points at one metre of depth.
"""

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

SEARCH_REACH = 0.012
"""Largest distance, as rays, of a supporting point from its position predicted by a pose, in the search."""
MIN_SUPPORT = 8
"""Least number of points that support a pose."""

_ENOUGH_WITH_DEPTH = 8
"""Least number of pairs with depth in both images for the search by triangles; with fewer, P3P is used."""
_TRIANGLES = 1200
_MAX_HYPOTHESES = 150
_SHORTEST_SIDE_M = 0.08
_DEPTH_GAP_WEIGHT = 0.2
"""Weight of a gap between inverse depths, in 1/m, relative to a gap between rays."""
_FOCAL = 500.0
"""Focal length that converts rays to pixels for OpenCV; its value does not matter."""
_NOWHERE = 1e3
"""Ray for points behind the camera, far from every other ray."""


class CameraMotion(NamedTuple):
    """Motion between two cameras: a point X in the first camera's frame is rotation X + translation in the second's."""

    rotation: NDArray[np.float64]
    """(3, 3)"""
    translation: NDArray[np.float64]
    """(3,) metres."""

    @property
    def turned_rad(self) -> float:
        """Angle of the rotation about its axis, in radians."""
        return float(np.arccos(np.clip((np.trace(self.rotation) - 1) / 2, -1, 1)))

    def inverse(self) -> "CameraMotion":
        """Return the inverse motion."""
        return CameraMotion(self.rotation.T, -self.rotation.T @ self.translation)

    def apply(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Transform points (N, 3) from the first camera's frame to the second's."""
        return points @ self.rotation.T + self.translation


class PointPairs(NamedTuple):
    """P points as seen in two images; depth is 0 where missing."""

    first_rays: NDArray[np.float64]
    first_depth: NDArray[np.float64]
    second_rays: NDArray[np.float64]
    second_depth: NDArray[np.float64]

    def swapped(self) -> "PointPairs":
        """Return the same points with the two images exchanged."""
        return PointPairs(self.second_rays, self.second_depth, self.first_rays, self.first_depth)

    def take(self, chosen: NDArray[np.bool_] | slice) -> "PointPairs":
        """Return the chosen points."""
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
    """Return the motion that most pairs support; None if fewer than `MIN_SUPPORT` do."""
    if np.count_nonzero((pairs.first_depth > 0) & (pairs.second_depth > 0)) >= _ENOUGH_WITH_DEPTH:
        return _search_by_depth(pairs)
    if np.count_nonzero(pairs.first_depth) >= np.count_nonzero(pairs.second_depth):
        return _search(pairs)
    found = _search(pairs.swapped())
    return None if found is None else found.inverse()


def _search_by_depth(pairs: PointPairs) -> CameraMotion | None:
    """Return the motion from triangles of three points, whose sides must be equal in both images."""
    known = pairs.take((pairs.first_depth > 0) & (pairs.second_depth > 0))
    first = points(known.first_rays, known.first_depth)
    second = points(known.second_rays, known.second_depth)
    drawn = np.random.default_rng(len(first)).integers(0, len(first), (_TRIANGLES, 3))
    corners_first = first[drawn]
    corners_second = second[drawn]
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
    # The sum of truncated squares (MSAC) prefers the more accurate of two poses with equal support.
    cost = np.minimum(gaps, SEARCH_REACH**2).sum(1)
    best = int(cost.argmin())
    if np.count_nonzero(gaps[best] < SEARCH_REACH**2) < MIN_SUPPORT:
        return None
    return CameraMotion(rotations[best], shifts[best])


def _alike_triangles(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the rows of triangles (N, 3, 3) that have equal sides in both images and are large enough."""
    sides_first = np.linalg.norm(first - np.roll(first, 1, axis=1), axis=2)
    sides_second = np.linalg.norm(second - np.roll(second, 1, axis=1), axis=2)
    alike = np.abs(sides_first - sides_second) < 0.03 + 0.1 * np.minimum(sides_first, sides_second)
    longest = sides_first.max(1)
    flat = sides_first.sum(1) - longest < 1.03 * longest
    return np.flatnonzero(alike.all(1) & (sides_first.min(1) > _SHORTEST_SIDE_M) & ~flat)[:_MAX_HYPOTHESES]


def _triangle_frames(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the axes (N, 3, 3), as columns, of the frames that triangles (N, 3, 3) define."""
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
    except cv2.error:  # The points are collinear.
        return None
    if not found or inliers is None or len(inliers) < MIN_SUPPORT:
        return None
    motion = CameraMotion(np.asarray(cv2.Rodrigues(turn)[0], np.float64), np.asarray(shift, np.float64).ravel())
    return motion if np.isfinite(motion.translation).all() else None


_ITERATIONS = 8
_MAX_REFINED = 200
"""Largest number of pairs in the refinement; more hardly improve a pose, and the strongest key points come first."""
_RAY_SIGMA = 0.004
"""Standard deviation of a key point as a ray: about one pixel of an image of 320 x 240."""
_INVERSE_DEPTH_SIGMA = 0.02
"""Standard deviation of measured inverse depth in 1/m, with the misalignment of colour and depth."""


class _Sighting(NamedTuple):
    """Points (N, 3) of one image, and their measurements in the other image."""

    points: NDArray[np.float64]
    rays: NDArray[np.float64]
    """(N, 2) measured rays."""
    inverse_depth: NDArray[np.float64]
    """(N,) measured inverse depth in 1/m."""
    depth_weight: NDArray[np.float64]
    """(N,) inverse of the standard deviation of the inverse depth; 0 where depth is missing."""


def refine_motion(motion: CameraMotion, pairs: PointPairs) -> tuple[CameraMotion, NDArray[np.float64]]:
    """Return the motion that fits all pairs best except outliers, and its covariance (6, 6): rotation, translation.

    Gauss-Newton on the rays in both images and the depths, each weighted by its accuracy, with a Cauchy loss.
    """
    pairs = pairs.take(slice(_MAX_REFINED))
    there = _sighting(pairs)
    back = _sighting(pairs.swapped())
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
    """Return the first image's points with depth, and their measurements in the second image."""
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
    """Return Jacobians (N, 3, 6) by rotation and translation, and residuals (N, 3) in sigmas, for both directions.

    `by_back` is the Jacobian (M, 3, 6) of the second image's points.
    """
    moved = motion.apply(there.points)
    forward = _ray_residuals(moved, _by_turn_and_shift(moved), there)
    inverse = motion.inverse()
    backward = _ray_residuals(inverse.apply(back.points), -inverse.rotation @ by_back, back)
    return np.concatenate([forward[0], backward[0]]), np.concatenate([forward[1], backward[1]])


def _by_turn_and_shift(places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the Jacobian (N, 3, 6) of points (N, 3) by a small rotation and translation."""
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
    """Return Jacobians (N, 3, 6) and residuals (N, 3) of points (N, 3) against their measurements."""
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


ROOM_DEPTH_M = 2.2
"""Usual distance of the surfaces in an indoor image, in metres; half and twice as much are common."""
MIN_PAIRS = 12
"""Least number of pairs for a motion without depth."""

_REACH = 0.004
"""Largest distance, as rays, of a key point from its epipolar line."""
_STANDING = 0.006
"""Median difference of the rays after the rotation below which the camera did not move."""
_EXACT_PIXEL_RAY = 1 / 250
"""Size of a pixel, as a ray, above which both limits grow, as in small images and with wide lenses."""


class EpipolarMotion(NamedTuple):
    """A motion with a guessed length, and the pairs that agree with it."""

    motion: CameraMotion
    agreeing: NDArray[np.bool_]
    """(P,) mask of the pairs that agree."""


def epipolar_motion(
    first_rays: NDArray[np.float64], second_rays: NDArray[np.float64], pixel_ray: float = _EXACT_PIXEL_RAY
) -> EpipolarMotion | None:
    """Return the motion that most pairs of rays (P, 2), (P, 2) agree with; None if fewer than `MIN_PAIRS` do.

    `pixel_ray` is the size of a pixel as a ray, `ImageGrid.pixel_ray`, which limits the accuracy of key points.
    """
    if len(first_rays) < MIN_PAIRS:
        return None
    coarse = max(1.0, pixel_ray / _EXACT_PIXEL_RAY)
    first = first_rays * _FOCAL
    second = second_rays * _FOCAL
    camera = np.diag([_FOCAL, _FOCAL, 1.0])
    try:
        essential, inliers = cv2.findEssentialMat(
            first, second, camera, method=cv2.USAC_MAGSAC, prob=0.999, threshold=coarse * _REACH * _FOCAL, maxIters=1000
        )
        if essential is None or essential.shape != (3, 3) or np.count_nonzero(inliers) < MIN_PAIRS:
            return None
        _, rotation, direction, _ = cv2.recoverPose(essential, first, second, camera, mask=inliers.copy())
    except cv2.error:  # All points coincide.
        return None
    agreeing = inliers.ravel() > 0
    standing = _turn_on_the_spot(first_rays[agreeing], second_rays[agreeing], coarse * _STANDING)
    if standing is not None:
        return EpipolarMotion(CameraMotion(standing, np.zeros(3)), agreeing)
    rotation, way = np.asarray(rotation, np.float64), np.asarray(direction, np.float64).ravel()
    length = _baseline_m(rotation, way, first_rays[agreeing], second_rays[agreeing])
    return EpipolarMotion(CameraMotion(rotation, way * length), agreeing)


def _turn_on_the_spot(
    first: NDArray[np.float64], second: NDArray[np.float64], standing: float
) -> NDArray[np.float64] | None:
    """Return the rotation (3, 3) if a rotation alone explains the rays (P, 2); None if the camera also moved.

    Without translation the epipolar geometry is degenerate and may give a mirrored motion.
    """
    before = _directions(first)
    after = _directions(second)
    weights = np.ones(len(before))
    rotation = np.eye(3)
    gaps = np.ones(len(before))
    for _ in range(5):
        u, _, v = np.linalg.svd((after * weights[:, None]).T @ before)
        rotation = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ v))]) @ v
        gaps = np.linalg.norm(before @ rotation.T - after, axis=1)
        weights = 1 / (1 + (gaps / standing) ** 2)
    return rotation if np.median(gaps) < standing else None


def _directions(rays: NDArray[np.float64]) -> NDArray[np.float64]:
    directions = np.column_stack([rays, np.ones(len(rays))])
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


def _baseline_m(
    rotation: NDArray[np.float64],
    direction: NDArray[np.float64],
    first: NDArray[np.float64],
    second: NDArray[np.float64],
) -> float:
    """Return the distance between the cameras, assuming that the points of rays (P, 2), (P, 2) have the usual depth."""
    turned = np.column_stack([first, np.ones(len(first))]) @ rotation.T
    ahead = np.maximum(turned[:, 2:], 0.1)
    parallax = np.linalg.norm(turned[:, :2] / ahead - second, axis=1)
    # second * z2 = turned * z1 + direction, solved for the depths in units of the baseline.
    seen = np.column_stack([second, np.ones(len(second))])
    across = np.cross(seen, turned)
    depth = -(np.cross(seen, direction) * across).sum(1) / np.maximum((across**2).sum(1), 1e-9)
    usual = depth[(depth > 0.2) & (parallax > _STANDING / 2)]
    return 0.0 if len(usual) < MIN_PAIRS // 2 else float(ROOM_DEPTH_M / np.median(usual))
