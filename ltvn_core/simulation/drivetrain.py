"""The drivetrain: wheel speeds follow the commanded velocity within acceleration limits.

Knows neither the drive lease, which decides what is commanded, nor the physics, which decides how the body moves.
"""

from ltvn_core.robots.robot_spec import AccelerationLimits
from ltvn_core.types import ZERO_TWIST, Twist


class Drivetrain:
    """Tracks commanded velocities with limited acceleration."""

    def __init__(self, accelerations: AccelerationLimits | None = None) -> None:
        self._limits = accelerations or AccelerationLimits()
        self.speeds = ZERO_TWIST

    def halt(self) -> None:
        """Set the speeds to zero without braking, as when the robot is lifted."""
        self.speeds = ZERO_TWIST

    def follow(self, command: Twist, duration_s: float) -> Twist:
        """Change the speeds towards `command` for `duration_s` seconds and return them."""
        if command == self.speeds:
            return self.speeds  # As in most of the 240 ticks of a second.
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
        self.speeds = Twist(linear_m_s, angular_rad_s)
        return self.speeds


def _approach(speed: float, target: float, *, most_gain: float, most_loss: float) -> float:
    """Change `speed` towards `target`, by at most `most_gain` when it grows and `most_loss` when it shrinks."""
    if speed * target < 0:
        target = 0.0  # A change of sign brakes to a stop first.
    most = most_loss if abs(target) < abs(speed) else most_gain
    return speed + max(-most, min(most, target - speed))
