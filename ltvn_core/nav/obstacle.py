"""Does the depth image show something in the way? Geometry of one image; no memory, no planning.

Sees only what the camera sees: nothing behind, nothing beside, and nothing low close by.
"""

import numpy as np
from numpy.typing import NDArray

from ltvn_core.types import Depth, Intrinsics

ROBOT_RADIUS_M = 0.18
_LOW_M, _HIGH_M = 0.04, 0.65
"""Between these heights above the floor things stop the robot."""
_TRUSTED_PIXELS = 3
"""Fewer pixels than this are noise."""


def points(depth: Depth, intrinsics: Intrinsics) -> NDArray[np.float64]:
    """Return (M, 3) x forward, y left, z above the floor of all pixels with a return."""
    rows, columns = np.nonzero(depth > 0)
    metres = depth[rows, columns].astype(np.float64)
    left = -(columns + 0.5 - intrinsics.width / 2) / intrinsics.focal_px * metres
    up = -(rows + 0.5 - intrinsics.height / 2) / intrinsics.focal_px * metres
    return np.stack([metres, left, up + intrinsics.height_m], axis=-1)


def free_ahead_m(depth: Depth, intrinsics: Intrinsics, half_width_m: float) -> float:
    """Return how far ahead of the camera the swept width is free; infinite if nothing stands in it."""
    cloud = points(depth, intrinsics)
    stopping = (np.abs(cloud[:, 1]) < half_width_m) & (cloud[:, 2] > _LOW_M) & (cloud[:, 2] < _HIGH_M)
    ahead = np.sort(cloud[stopping, 0])
    return float(ahead[_TRUSTED_PIXELS - 1]) if len(ahead) >= _TRUSTED_PIXELS else np.inf


def is_blocked(depth: Depth, intrinsics: Intrinsics, *, ahead_m: float, margin_m: float) -> bool:
    """Tell whether the robot would touch something within `ahead_m` straight ahead."""
    return free_ahead_m(depth, intrinsics, ROBOT_RADIUS_M + margin_m) < ROBOT_RADIUS_M + margin_m + ahead_m
