"""Wheel odometry with the errors that wheels have.

Owns the drift between where the robot is and where it believes to be. An error is a scale, not a jitter: wheels that
measure 1 % too much do so for a while. So each error is drawn anew after every metre driven or radian turned, which
makes single legs proportionally wrong, long drives drift like a random walk, and the result independent of how the
motion is cut into pieces.
"""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ltvn_core.types import Pose


@dataclass(frozen=True, slots=True)
class OdometryNoise:
    """Standard deviations of the errors; they are unbiased."""

    distance: float = 0.02
    """Of the driven distance, as a share of it."""
    angle: float = 0.01
    """Of the turned angle, as a share of it."""
    drift_rad_per_m: float = 0.01
    """Unnoticed turning while driving."""

    NONE: ClassVar["OdometryNoise"]
    """Wheels that never err."""


OdometryNoise.NONE = OdometryNoise(0.0, 0.0, 0.0)

ERROR_SECTION_LENGTH = 1.0
"""Metres driven plus radians turned until the errors are drawn anew."""


class Odometer:
    """Integrates motions into a pose that drifts."""

    def __init__(self, start: Pose, noise: OdometryNoise, rng: np.random.Generator) -> None:
        self._noise = noise
        self._rng = rng
        self.restart(start)

    @property
    def pose(self) -> Pose:
        """Where the robot believes to be, (3,) in the odometry frame."""
        return np.array([self._x, self._y, math.remainder(self._yaw, 2 * math.pi)])

    def restart(self, pose: Pose) -> None:
        """Believe to be at `pose` (3,) from now on."""
        self._x, self._y, self._yaw = (float(value) for value in pose)
        self._begin_section()

    def move(self, forward_m: float, left_m: float, turn_rad: float) -> None:
        """Add a small true motion, given in the robot's frame before it."""
        driven = math.hypot(forward_m, left_m)
        scale = 1 + self._distance_error
        turn = turn_rad * (1 + self._angle_error) + driven * self._drift
        heading = self._yaw + turn / 2  # Half-way through the turn, the chord of the arc.
        offset = -turn_rad / 2  # The motion was given in the frame before the turn.
        cos, sin = math.cos(heading + offset), math.sin(heading + offset)
        self._x += scale * (cos * forward_m - sin * left_m)
        self._y += scale * (sin * forward_m + cos * left_m)
        self._yaw += turn
        self._left_in_section -= driven + abs(turn_rad)
        if self._left_in_section <= 0:
            self._begin_section()

    def _begin_section(self) -> None:
        noise = self._noise
        draws = self._rng.normal(0.0, (noise.distance, noise.angle, noise.drift_rad_per_m))
        self._distance_error, self._angle_error, self._drift = (float(draw) for draw in draws)
        self._left_in_section = ERROR_SECTION_LENGTH
