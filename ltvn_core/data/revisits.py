"""Which images of a drive were taken near each other, and which places it revisits, by its odometry."""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ltvn_core.geometry import lengths_along, wrap_angle
from ltvn_core.types import Pose

NEAR_M = 0.6
NEAR_RAD = math.radians(20)
"""Largest distance in metres, and largest difference of heading, of images that can be compared; edges join such
images."""
_REVISIT_PATH_M = 3.0
_REVISIT_S = 10.0
"""Distance in metres, or time in seconds while turning on the spot, after which a place counts as revisited."""


def near_pairs(poses: Pose) -> NDArray[np.intp]:
    """Return the rows (K, 2) of poses (N, 3) that are near each other."""
    # Headings lie on a circle on which the chord of NEAR_RAD is as long as NEAR_M.
    radius = NEAR_M / (2 * math.sin(NEAR_RAD / 2))
    points = np.column_stack([poses[:, :2], radius * np.cos(poses[:, 2]), radius * np.sin(poses[:, 2])])
    pairs = KDTree(points).query_pairs(NEAR_M * math.sqrt(2), output_type="ndarray")
    apart = poses[pairs[:, 1]] - poses[pairs[:, 0]]
    near = (np.hypot(apart[:, 0], apart[:, 1]) < NEAR_M) & (np.abs(wrap_angle(apart[:, 2])) < NEAR_RAD)
    return pairs[near]


def revisits(pairs: NDArray[np.intp], poses: Pose, stamps: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the near pairs (K, 2) whose images lie on two passes of one place, the earlier row first.

    Args:
        pairs: Rows, as `near_pairs` returns them.
        poses: (N, 3), by odometry.
        stamps: (N,), seconds.
    """
    way_m = lengths_along(poses[:, :2])
    in_order = np.sort(pairs, axis=1)
    driven_m, passed_s = (np.diff(each[in_order])[:, 0] for each in (way_m, stamps))
    return in_order[(driven_m >= _REVISIT_PATH_M) | (passed_s >= _REVISIT_S)]
