"""Steers a robot along a path by its exact pose, as a person would who sees both. Drives nothing itself."""

import numpy as np
from numpy.typing import NDArray

from ltvn_core.geometry import wrap_angle
from ltvn_core.types import Pose, Twist


class PathFollower:
    """One path, until its end is reached (pure pursuit)."""

    def __init__(
        self,
        path: NDArray[np.float64],
        *,
        speed_m_s: float = 0.4,
        lookahead_m: float = 0.3,
        turn_first_rad: float = 0.5,
        arrived_m: float = 0.15,
    ) -> None:
        """Follow `path`, (M, 2) x and y in metres.

        The robot steers towards the first point that is farther away than `lookahead_m`, turns on the spot above
        `turn_first_rad`, and is there within `arrived_m` of the end.
        """
        self.path = path
        self._speed_m_s, self._lookahead_m = speed_m_s, lookahead_m
        self._turn_first_rad, self._arrived_m = turn_first_rad, arrived_m
        self._ahead = 0

    def twist(self, pose: Pose) -> Twist | None:
        """Return the velocity to drive with from a pose (3,); None at the end of the path."""
        path = self.path
        if np.hypot(*(path[-1] - pose[:2])) < self._arrived_m:
            return None
        while self._ahead < len(path) - 1 and np.hypot(*(path[self._ahead] - pose[:2])) < self._lookahead_m:
            self._ahead += 1
        return self._towards(pose, path[self._ahead])

    def _towards(self, pose: Pose, point: NDArray[np.float64]) -> Twist:
        offset = point - pose[:2]
        heading_error = float(wrap_angle(np.arctan2(offset[1], offset[0]) - pose[2]))
        if abs(heading_error) > self._turn_first_rad:
            return Twist(0.0, float(np.sign(heading_error)))
        angular_rad_s = float(np.clip(2.5 * heading_error, -1.0, 1.0))
        return Twist(self._speed_m_s * float(np.cos(heading_error)), angular_rad_s)
