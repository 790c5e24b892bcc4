"""The wheels of the simulated robot: speeds that follow commands, and odometry with realistic drift.

Errors are scale errors instead of jitter: wheels that measure 1 % too much do so for a while. Each error is drawn again
after a metre driven or a radian turned. So the error of a short motion is proportional to its length, long drives drift
like a random walk, and the result does not depend on the length of a simulation step. A slip is a sudden error.

Independent of the drive lease, which decides about commands, and of the physics, which decides about motion.
"""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ltvn_core.robots.robot_spec import AccelerationLimits, SpeedLimits
from ltvn_core.types import ZERO_TWIST, Pose, Twist


class Drivetrain:
    """Tracks commanded velocities with limited acceleration and a limited turning radius."""

    def __init__(self, accelerations: AccelerationLimits | None = None, speeds: SpeedLimits | None = None) -> None:
        self._limits = accelerations or AccelerationLimits()
        self._steering = speeds or SpeedLimits()
        self.speeds = ZERO_TWIST

    def halt(self) -> None:
        """Set the speeds to zero without braking, as when the robot is lifted."""
        self.speeds = ZERO_TWIST

    def follow(self, command: Twist, duration_s: float) -> Twist:
        """Change the speeds towards `command` for `duration_s` seconds and return them."""
        if command == self.speeds:
            return self.speeds  # The usual case, 240 times a second.
        limits = self._limits
        linear_m_s = _approach(
            self.speeds.linear_m_s,
            command.linear_m_s,
            most_gain=limits.linear_m_s2 * duration_s,
            most_loss=limits.linear_braking_m_s2 * duration_s,
        )
        angular_rad_s = _approach(
            self.speeds.angular_rad_s,
            command.angular_rad_s,
            most_gain=limits.angular_rad_s2 * duration_s,
            most_loss=limits.angular_braking_rad_s2 * duration_s,
        )
        self.speeds = self._steering.curved(Twist(linear_m_s, angular_rad_s))
        return self.speeds


def _approach(speed: float, target: float, *, most_gain: float, most_loss: float) -> float:
    """Change `speed` towards `target`, by at most `most_gain` when it grows and `most_loss` when it shrinks."""
    if speed * target < 0:
        target = 0.0  # A change of sign brakes to a stop first.
    most = most_loss if abs(target) < abs(speed) else most_gain
    return speed + max(-most, min(most, target - speed))


@dataclass(frozen=True, slots=True)
class OdometryNoise:
    """Standard deviations of the odometry's errors; their means are zero."""

    distance: float = 0.02
    """Error of the driven distance, as a share of it."""
    angle: float = 0.01
    """Error of the turned angle, as a share of it."""
    drift_rad_per_m: float = 0.01
    """Change of heading that the wheels do not measure, in radians per metre driven."""
    slips: float = 0.0
    """Chance per section (a metre driven or a radian turned) that the wheels slip: the measured pose jumps by
    `SLIP_M` and `SLIP_RAD`."""

    NONE: ClassVar["OdometryNoise"]
    """Exact odometry."""


OdometryNoise.NONE = OdometryNoise(0.0, 0.0, 0.0)


SLIP_M = 0.15
"""Standard deviation of a slip along the heading (ours), as at a threshold or the edge of a carpet, in metres."""


SLIP_RAD = 0.12
"""Standard deviation of a slip of the heading (ours), in radians."""


ERROR_SECTION_LENGTH = 1.0
"""Metres driven plus radians turned after which the errors are drawn again."""


class Odometer:
    """Integrates motions with errors into a pose that drifts."""

    def __init__(self, start: Pose, noise: OdometryNoise, rng: np.random.Generator) -> None:
        self._noise = noise
        self._rng = rng
        self.restart(start)

    @property
    def pose(self) -> Pose:
        """The measured pose, (3,) in the odometry frame."""
        return np.array([self._x, self._y, math.remainder(self._yaw, 2 * math.pi)])

    def restart(self, pose: Pose) -> None:
        """Set the measured pose to `pose` (3,) and draw new errors."""
        self._x, self._y, self._yaw = (float(value) for value in pose)
        self._begin_section()

    def move(self, forward_m: float, left_m: float, turn_rad: float) -> None:
        """Add a small true motion, given in the robot's frame at its beginning."""
        if not (forward_m or left_m or turn_rad):
            return
        driven = math.hypot(forward_m, left_m)
        scale = 1 + self._distance_error
        turn = turn_rad * (1 + self._angle_error) + driven * self._drift
        heading = self._yaw + turn / 2  # The chord of an arc has the heading at half of the turn.
        offset = -turn_rad / 2  # The true motion is given in the frame at its beginning, not at half of its turn.
        cos = math.cos(heading + offset)
        sin = math.sin(heading + offset)
        self._x += scale * (cos * forward_m - sin * left_m)
        self._y += scale * (sin * forward_m + cos * left_m)
        self._yaw += turn
        self._left_in_section -= driven + abs(turn_rad)
        if self._left_in_section <= 0:
            self._begin_section()
            self._slip()

    def _slip(self) -> None:
        # Without slips nothing is drawn, so that the random numbers of other drives do not change.
        if self._noise.slips and self._rng.random() < self._noise.slips:
            forward, turn = (float(draw) for draw in self._rng.normal(0.0, (SLIP_M, SLIP_RAD)))
            self._x += math.cos(self._yaw) * forward
            self._y += math.sin(self._yaw) * forward
            self._yaw += turn

    def _begin_section(self) -> None:
        noise = self._noise
        draws = self._rng.normal(0.0, (noise.distance, noise.angle, noise.drift_rad_per_m))
        self._distance_error, self._angle_error, self._drift = (float(draw) for draw in draws)
        self._left_in_section = ERROR_SECTION_LENGTH
