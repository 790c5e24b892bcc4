"""What a guard lets through to the wheels: fresh commands, within the limits, and a zero once when they stop coming.

Runs on a steady clock that is handed in. At the beginning, after silence, and after a pause of its own, a driver must
send a zero before it may drive. Sends nothing itself.
"""

import math
import threading
from collections.abc import Callable

from ltvn_core.robots.robot_spec import AccelerationLimits, SpeedLimits
from ltvn_core.types import ZERO_TWIST, Twist

SILENCE_S = 0.2
"""A driver that was not heard for so long is gone. With the time it takes to look, to send and to brake, a robot stands
within 300 ms; commands come 20 times a second."""
PAUSE_S = 0.3
"""A guard that was not asked for so long was stopped itself."""


class CommandGate:
    """The gate of one robot. Safe to use from several threads."""

    def __init__(
        self,
        clock: Callable[[], float],
        *,
        speeds: SpeedLimits,
        accelerations: AccelerationLimits,
        allows: Callable[[Twist], Twist] = lambda twist: twist,
    ) -> None:
        """Stand; `allows` returns what of a command the surroundings permit."""
        self._clock = clock
        self._speeds = speeds
        self._accelerations = accelerations
        self._allows = allows
        self._lock = threading.Lock()
        self._wanted = ZERO_TWIST
        self._output = ZERO_TWIST
        self._heard_s = -math.inf
        self._asked_s = clock()
        self._must_stop_first = True

    @property
    def must_stop_first(self) -> bool:
        """Whether commands are refused until the driver has sent a zero."""
        return self._must_stop_first

    def hear(self, twist: Twist) -> Twist | None:
        """Take a fresh command; return what is to be sent now, None for nothing."""
        with self._lock:
            now_s = self._clock()
            pause = self._after_pause(now_s)
            if twist == ZERO_TWIST:
                self._must_stop_first = False
            elif self._must_stop_first:
                return pause
            self._heard_s, self._wanted = now_s, self._speeds.bounded(twist)
            return self._next(now_s)

    def turn(self) -> Twist | None:
        """Return what is to be sent now, where nothing was heard; None for nothing. Call it 50 times a second."""
        with self._lock:
            now_s = self._clock()
            pause = self._after_pause(now_s)
            if pause is not None:
                return pause
            if self._wanted == ZERO_TWIST:
                self._asked_s = now_s
                return None
            if now_s - self._heard_s >= SILENCE_S:
                return self._halt()
            return self._next(now_s)

    def close(self) -> Twist:
        """Let nothing through any more; return the last zero."""
        with self._lock:
            return self._halt()

    def _after_pause(self, now_s: float) -> Twist | None:
        """Return a zero where this process itself stood still while the robot drove."""
        paused = now_s - self._asked_s > PAUSE_S and self._wanted != ZERO_TWIST
        self._asked_s = now_s if paused else self._asked_s
        return self._halt() if paused else None

    def _halt(self) -> Twist:
        self._wanted = self._output = ZERO_TWIST
        self._must_stop_first = True
        return ZERO_TWIST

    def _next(self, now_s: float) -> Twist:
        """Come as near to what is wanted as the accelerations allow; a zero is passed on at once."""
        passed_s, self._asked_s = min(max(now_s - self._asked_s, 0.0), 0.1), now_s
        goal = self._allows(self._wanted)
        if goal == ZERO_TWIST:
            self._output = ZERO_TWIST
            return ZERO_TWIST
        faster, most = self._accelerations, self._output
        self._output = Twist(
            _towards(
                most.linear_m_s, goal.linear_m_s, passed_s * faster.linear_m_s2, passed_s * faster.linear_braking_m_s2
            ),
            _towards(
                most.angular_rad_s,
                goal.angular_rad_s,
                passed_s * faster.angular_rad_s2,
                passed_s * faster.angular_braking_rad_s2,
            ),
        )
        return self._output


def _towards(speed: float, goal: float, speeding_up: float, braking: float) -> float:
    """Return a speed nearer to the goal, by no more than the change that is allowed."""
    is_braking = abs(goal) < abs(speed) or goal * speed < 0
    most = braking if is_braking else speeding_up
    return speed + min(max(goal - speed, -most), most)
