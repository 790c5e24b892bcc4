"""Sends drive commands to a robot of ROS 2, 20 times a second under a lease, in a thread of its own.

When the lease ends, exactly one zero follows; a stop is a zero at once. After a break, of the link or of this program,
nothing is driven until whoever drives has let go for a moment: driving does not come back by itself.
"""

import logging
import math
import threading
import time
from collections.abc import Callable
from typing import Any

from ltvn_core.robots.drive_lease import LEASE_S, DriveLease
from ltvn_core.robots.robot_spec import SpeedLimits
from ltvn_core.types import ZERO_TWIST, Twist

_LOG = logging.getLogger(__name__)
_EVERY_S = 0.05
_BREAK_S = LEASE_S
"""A turn that took so long is a break: the program was stopped or the machine slept, and the robot has stopped."""
LET_GO_S = 0.5
"""Who asked for nothing for so long has let go."""


class CommandSender:
    """The one place from which commands leave."""

    def __init__(self, send: Callable[[Twist], Any], is_connected: Callable[[], bool], limits: SpeedLimits) -> None:
        """Begin with a stop; `send` puts a command onto the wire."""
        self.lease = DriveLease(time.monotonic, limits=limits)
        self._reason: str | None = None
        self._asked_s = -math.inf
        self._send = send
        self._is_connected = is_connected
        self._moving = False
        self._closed = False
        self._lock = threading.Lock()
        self._wake = threading.Event()
        self._send(ZERO_TWIST)
        self._thread = threading.Thread(target=self._run, name="commands", daemon=True)
        self._thread.start()

    @property
    def break_reason(self) -> str | None:
        """Why nothing is driven until the driver lets go; None where all is well."""
        if self._reason is not None and time.monotonic() - self._asked_s >= LET_GO_S:
            self._reason = None
        return self._reason

    def drive(self, twist: Twist) -> None:
        """Command a velocity for the time of a lease. Raises ValueError where a speed is not finite."""
        is_broken = self.break_reason is not None
        self._asked_s = time.monotonic()
        if not is_broken:
            self.lease.grant(twist)
            self._wake.set()

    def interrupt(self, reason: str) -> None:
        """Stop; where somebody drives, drive nothing until that driver has let go."""
        self.lease.cancel()
        self._wake.set()
        if self.break_reason is None and time.monotonic() - self._asked_s < LET_GO_S:
            self._break(reason)

    def stop(self) -> None:
        """Send a zero now."""
        with self._lock:
            self.lease.cancel()
            self._moving = False
            self._send(ZERO_TWIST)

    def close(self) -> None:
        """Stop for good."""
        self._closed = True
        self._wake.set()
        self._thread.join()
        self.stop()

    def _run(self) -> None:
        turned_s = time.monotonic()
        while not self._closed:
            self._wake.wait(_EVERY_S)
            self._wake.clear()
            now_s = time.monotonic()
            self._turn(now_s - turned_s)
            turned_s = now_s

    def _turn(self, took_s: float) -> None:
        with self._lock:
            if self._moving and took_s > _BREAK_S:
                self._break(f"this program stood still for {took_s:.1f} s while the robot drove")
            elif self._moving and not self._is_connected():
                self._break("the link to the robot broke")
            twist = self.lease.command()
            if twist != ZERO_TWIST and not self._moving:
                self._send(ZERO_TWIST)  # A guard that was started since lets nobody drive who did not stop first.
            if twist != ZERO_TWIST or self._moving:
                self._send(twist)
            self._moving = twist != ZERO_TWIST

    def _break(self, reason: str) -> None:
        self.lease.cancel()
        self._reason = reason
        self._asked_s = time.monotonic()  # Whoever drove before the break is not yet known to have let go.
        _LOG.warning("The robot is stopped: %s. Let go for a moment, then drive again.", reason)
