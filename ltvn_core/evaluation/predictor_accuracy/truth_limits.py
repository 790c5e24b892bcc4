"""Which pairs of images are near and which are far, by true poses. What stands between them does not count."""

from dataclasses import dataclass
from math import radians

import numpy as np
from numpy.typing import NDArray

from ltvn_core.geometry import relative
from ltvn_core.types import Pose, Waypoint


@dataclass(frozen=True, slots=True)
class TruthLimits:
    """Limits of near and far pairs; a pair between them has no label."""

    near_m: float = 0.6
    """The target of a near pair lies nearer than this, in front of the source,"""
    near_rad: float = radians(20)
    """and is turned by less than this."""
    far_m: float = 1.5
    """The target of a far pair lies farther away than this,"""
    far_rad: float = radians(60)
    """or is turned by more than this."""

    def near(self, waypoints: Waypoint) -> NDArray[np.bool_]:
        """Tell which true waypoints (..., 3) lead to a near target."""
        near = np.hypot(waypoints[..., 0], waypoints[..., 1]) < self.near_m
        return near & (np.abs(waypoints[..., 2]) < self.near_rad) & (waypoints[..., 0] > 0)

    def far(self, waypoints: Waypoint) -> NDArray[np.bool_]:
        """Tell which true waypoints (..., 3) lead to a far target."""
        return (np.hypot(waypoints[..., 0], waypoints[..., 1]) > self.far_m) | (
            np.abs(waypoints[..., 2]) > self.far_rad
        )


LIMITS = TruthLimits()
"""What `ltvn judge` calls near and far."""


def true_waypoints(sources: Pose, targets: Pose) -> Waypoint:
    """Return the true waypoints (S, T, 3) from all sources (S, 3) to all targets (T, 3)."""
    return relative(sources[:, None], targets[None])
