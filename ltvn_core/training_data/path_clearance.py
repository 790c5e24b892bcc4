"""How much room depth leaves beside the straight way to a target; stands in where no map knows the obstacles.

Owns the geometry. Only what the source sees counts, so an obstacle out of view goes unnoticed.
"""

import numpy as np
from numpy.typing import NDArray

from ltvn_core.types import Intrinsics, Waypoint

LOW_M = 0.1
HIGH_M = 0.9
"""What stands between these heights above the floor is in the robot's way."""

_STEP = 3
"""Looks at every third pixel of a row and of a column."""


def clearance_from_depth(
    waypoints: Waypoint, source_depth: NDArray[np.floating], camera: Intrinsics
) -> NDArray[np.float64]:
    """Return the metres (P,) between the straight way to each waypoint (P, 3) and the nearest thing seen beside it.

    Depth is (P, H, W) in metres; infinity where nothing is seen at the robot's height.
    """
    half = _STEP // 2
    rows = np.arange(half, camera.height, _STEP) + 0.5
    columns = np.arange(half, camera.width, _STEP) + 0.5
    depth = source_depth[:, half::_STEP, half::_STEP].astype(np.float32)
    left = ((camera.width / 2 - columns) / camera.focal_px).astype(np.float32) * depth
    height = ((camera.height / 2 - rows) / camera.focal_px)[:, None].astype(np.float32) * depth + camera.height_m
    ends = waypoints[:, :2].astype(np.float32)
    length = np.maximum((ends**2).sum(1), 1e-6)
    ahead_x = ends[:, 0, None, None]
    ahead_y = ends[:, 1, None, None]
    along = np.clip((depth * ahead_x + left * ahead_y) / length[:, None, None], 0, 1)
    beside = np.hypot(depth - along * ahead_x, left - along * ahead_y)
    in_the_way = (depth > 0) & (height > LOW_M) & (height < HIGH_M)
    return np.where(in_the_way, beside, np.inf).min((1, 2)).astype(np.float64)
