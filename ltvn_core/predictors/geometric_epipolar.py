"""How a camera moved between two images of which neither has depth: how it turned, and which way it went.

How far it went nobody can say from two such images; it is guessed, as if what they show were so far away as things in
rooms mostly are. Owns that guess and the search for the epipolar geometry (OpenCV).
"""

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from ltvn_core.predictors.geometric_pose import CameraMotion

ROOM_DEPTH_M = 2.2
"""What an image shows indoors is mostly so far away; half and twice as far is common."""
MIN_PAIRS = 12
"""Fewer pairs say nothing without depth."""

_REACH = 0.004
"""A key point may be so far from its epipolar line, as a ray."""
_STANDING = 0.006
"""Where the rays differ by less than this after the turn, the camera did not move."""
_EXACT_PIXEL_RAY = 1 / 250
"""Where a pixel is more than this as a ray, as in small images and those of wide lenses, the reaches above grow."""
_FOCAL = 500.0


class EpipolarMotion(NamedTuple):
    """A motion whose length is a guess, and the pairs that agree with it."""

    motion: CameraMotion
    agreeing: NDArray[np.bool_]
    """(P,)"""


def epipolar_motion(
    first_rays: NDArray[np.float64], second_rays: NDArray[np.float64], pixel_ray: float = _EXACT_PIXEL_RAY
) -> EpipolarMotion | None:
    """Return the motion that most pairs of rays (P, 2), (P, 2) agree with; None where too few do.

    `pixel_ray` is how far a pixel reaches as a ray, `ImageGrid.pixel_ray`: no key point is seen more exactly than that.
    """
    if len(first_rays) < MIN_PAIRS:
        return None
    coarse = max(1.0, pixel_ray / _EXACT_PIXEL_RAY)
    first, second = first_rays * _FOCAL, second_rays * _FOCAL
    camera = np.diag([_FOCAL, _FOCAL, 1.0])
    try:
        essential, inliers = cv2.findEssentialMat(
            first, second, camera, method=cv2.USAC_MAGSAC, prob=0.999, threshold=coarse * _REACH * _FOCAL, maxIters=1000
        )
        if essential is None or essential.shape != (3, 3) or np.count_nonzero(inliers) < MIN_PAIRS:
            return None
        _, rotation, direction, _ = cv2.recoverPose(essential, first, second, camera, mask=inliers.copy())
    except cv2.error:  # All points in one place.
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
    """Return the rotation (3, 3) that explains rays (P, 2) alone; None where the camera moved too.

    A camera that only turned has no direction of motion, and the epipolar geometry may mirror it.
    """
    before, after = _directions(first), _directions(second)
    weights = np.ones(len(before))
    rotation, gaps = np.eye(3), np.ones(len(before))
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
    """Return how far the camera went if what the rays (P, 2), (P, 2) show is at the usual depth."""
    turned = np.column_stack([first, np.ones(len(first))]) @ rotation.T
    ahead = np.maximum(turned[:, 2:], 0.1)
    parallax = np.linalg.norm(turned[:, :2] / ahead - second, axis=1)
    # second * z2 = turned * z1 + direction, solved for the depths in units of the baseline.
    seen = np.column_stack([second, np.ones(len(second))])
    across = np.cross(seen, turned)
    depth = -(np.cross(seen, direction) * across).sum(1) / np.maximum((across**2).sum(1), 1e-9)
    usual = depth[(depth > 0.2) & (parallax > _STANDING / 2)]
    return 0.0 if len(usual) < MIN_PAIRS // 2 else float(ROOM_DEPTH_M / np.median(usual))
