"""The drive lease: a velocity command that expires by itself.

Guarantees that a robot stops when its driver no longer sends commands (a watchdog). The clock is a parameter, so the
same class serves a simulated robot (its own time) and a real one (`time.monotonic`). It drives no motor: the motor loop
reads `command` in each of its steps.
"""

import math
import threading
from collections.abc import Callable

from ltvn_core.robots.robot_spec import SpeedLimits
from ltvn_core.types import ZERO_TWIST, Twist

LEASE_S = 0.25
"""Time for which one drive command is valid, in seconds of the robot's clock."""


class DriveLease:
    """Holds the newest drive command until it expires. Safe to use from several threads."""

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
        """Number of commands that expired without being renewed or cancelled; each led to exactly one stop."""
        return self._expiries

    def grant(self, twist: Twist) -> None:
        """Command a velocity from now until the lease ends, in place of any earlier command.

        A velocity beyond the limits is scaled down along its arc.

        Raises:
            ValueError: A speed is NaN or infinite. The earlier command is cancelled then too: a driver that sends
                invalid speeds is broken, and a broken driver must not keep the robot moving.
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
        """Command zero velocity until the next `grant`."""
        with self._lock:
            self._twist = ZERO_TWIST

    def command(self) -> Twist:
        """Return the velocity that is commanded now; zero after the end of the lease."""
        if self._twist is ZERO_TWIST:
            return ZERO_TWIST  # Read without the lock, because a simulated robot calls this 240 times a second.
        with self._lock:
            # The tolerance is for clocks that sum up ticks: rounding must not extend a lease by one tick.
            if self._twist != ZERO_TWIST and self._clock() >= self._ends_s - 1e-9:
                self._twist = ZERO_TWIST
                self._expiries += 1
            return self._twist
