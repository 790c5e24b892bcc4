"""The drive lease: a velocity command that expires by itself.

Owns the promise that a robot nobody talks to any more stands still. Pure: the clock comes in, so the same class serves
a simulated robot (its own time) and a real one (`time.monotonic`). Owns no motor; whoever does asks `command` in its
own loop and obeys.
"""

import math
import threading
from collections.abc import Callable
from dataclasses import dataclass

from ltvn_core.types import ZERO_TWIST, Twist

LEASE_S = 0.25
"""How long one drive command holds, in seconds of the robot's clock."""


@dataclass(frozen=True, slots=True)
class SpeedLimits:
    """How fast the robot may ever be told to go."""

    linear_m_s: float = 0.5
    angular_rad_s: float = 1.0

    def bounded(self, twist: Twist) -> Twist:
        """Return `twist` slowed down into the limits along the same arc.

        Raises ValueError when it holds NaN or infinity.
        """
        if not (math.isfinite(twist.linear_m_s) and math.isfinite(twist.angular_rad_s)):
            raise ValueError(
                f"A drive command must be two finite speeds, got linear {twist.linear_m_s} m/s and angular "
                f"{twist.angular_rad_s} rad/s; the robot stops. Send speeds within +-{self.linear_m_s} m/s and "
                f"+-{self.angular_rad_s} rad/s."
            )
        excess = max(abs(twist.linear_m_s) / self.linear_m_s, abs(twist.angular_rad_s) / self.angular_rad_s, 1.0)
        return Twist(twist.linear_m_s / excess, twist.angular_rad_s / excess)


class DriveLease:
    """Holds the newest drive command until it runs out. Safe to use from several threads."""

    def __init__(
        self, clock: Callable[[], float], *, valid_s: float = LEASE_S, limits: SpeedLimits | None = None
    ) -> None:
        self.limits = limits or SpeedLimits()
        self._clock = clock
        self._valid_s = valid_s
        self._lock = threading.Lock()
        self._twist = ZERO_TWIST
        self._ends_s = -math.inf
        self._expiries = 0

    @property
    def expiries(self) -> int:
        """How many commands ran out without being renewed or cancelled; each led to exactly one stop."""
        return self._expiries

    def grant(self, twist: Twist) -> None:
        """Command a velocity from now until the lease ends, in place of any earlier command.

        A speed beyond the limits is slowed down along its arc. Raises ValueError for NaN or infinity, and then the
        earlier command is cancelled too: a driver that sends nonsense is not to be trusted with the old one either.
        """
        try:
            bounded = self.limits.bounded(twist)
        except ValueError:
            self.cancel()
            raise
        with self._lock:
            self._twist = bounded
            self._ends_s = self._clock() + self._valid_s

    def cancel(self) -> None:
        """Stand still from now on, until the next grant."""
        with self._lock:
            self._twist = ZERO_TWIST

    def command(self) -> Twist:
        """Return the velocity to obey now; after the end of the lease that is standing still."""
        with self._lock:
            if self._twist != ZERO_TWIST and self._clock() >= self._ends_s - 1e-9:
                self._twist = ZERO_TWIST
                self._expiries += 1
            return self._twist
