"""The wheels: speeds follow commands no faster than the motors and brakes allow.

Owns the accelerations. Knows neither the lease, which decides what is commanded, nor the world, which decides what
comes of it.
"""

from dataclasses import dataclass

from ltvn_core.types import ZERO_TWIST, Twist


@dataclass(frozen=True, slots=True)
class AccelerationLimits:
    """How fast the speeds may change.

    Braking is firm on purpose: from full speed the robot stands after 42 ms, so that a lease of 250 ms plus braking
    stays below 300 ms.
    """

    linear_m_s2: float = 1.5
    angular_rad_s2: float = 6.0
    linear_braking_m_s2: float = 12.0
    angular_braking_rad_s2: float = 24.0


class Drivetrain:
    """Turns commanded speeds into real ones."""

    def __init__(self, accelerations: AccelerationLimits | None = None) -> None:
        self._limits = accelerations or AccelerationLimits()
        self.speeds = ZERO_TWIST

    def halt(self) -> None:
        """Stand still at once, as when the robot is lifted."""
        self.speeds = ZERO_TWIST

    def follow(self, command: Twist, duration_s: float) -> Twist:
        """Move the speeds towards `command` for a while and return them."""
        limits = self._limits
        self.speeds = Twist(
            _approach(
                self.speeds.linear_m_s,
                command.linear_m_s,
                limits.linear_m_s2 * duration_s,
                limits.linear_braking_m_s2 * duration_s,
            ),
            _approach(
                self.speeds.angular_rad_s,
                command.angular_rad_s,
                limits.angular_rad_s2 * duration_s,
                limits.angular_braking_rad_s2 * duration_s,
            ),
        )
        return self.speeds


def _approach(speed: float, wanted: float, gain: float, loss: float) -> float:
    """Change `speed` towards `wanted` by at most `gain` when it grows and `loss` when it shrinks."""
    if speed * wanted < 0:
        wanted = 0.0  # Turning round goes through standing still.
    largest = loss if abs(wanted) < abs(speed) else gain
    return speed + max(-largest, min(largest, wanted - speed))
