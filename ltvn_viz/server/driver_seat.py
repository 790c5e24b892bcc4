"""The driver's seat: the page that drives, its held inputs, and their expiry.

Pure logic with an injected clock; independent of sockets and robots. Safe to call from any thread. The rules:

* One driver at a time. The seat is taken by the first input while it is free, or by `take_over`.
* A held input is a lease: it counts for `lease_s` after the last message. `current_twist` is a function of time, so a
  thread that polls it stops the robot even when the thread that receives messages hangs.
* A page that draws slowly notices inputs late, and sends their age. The older an input is, the slower it drives; at
  `hand_limit_s` it no longer counts, even if it is repeated: it neither drives, nor takes the seat, nor arms a client.
* After every stop, except when the driver lets go, a new *epoch* begins, in which no client is *armed*. A client is
  armed by an empty input that names the present epoch. So neither an input held since before the stop nor a delayed
  message can start the robot again.
"""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from enum import StrEnum
from typing import TypeAlias

from ltvn_core.types import Twist
from ltvn_viz.server.keymap import Direction

ClientId: TypeAlias = int
"""Number of an open page, counted from 1; a reloaded page is a new client."""

LEASE_S = 0.25
"""Time in seconds for which a held input counts after its last message."""
HAND_LIMIT_S = 1.0
"""Age in seconds, since the page last checked a held input, from which the input no longer counts."""
IDLE_S = 30.0
"""Time in seconds without input after which the seat is free again."""
MAX_LINEAR_M_S = 0.5
MAX_ANGULAR_RAD_S = 1.0
SLOW_SCALE = 0.4


class StopReason(StrEnum):
    """Reason why the motion ended; the value is the text on the page."""

    RELEASED = "keys released"
    INPUT_LOST = "input lost"
    STOPPED = "stopped"
    TAKEN_OVER = "taken over"
    LEFT = "page closed"
    GAVE_UP = "seat given up"


@dataclass(frozen=True, slots=True)
class HeldInput:
    """All inputs that a person holds at one moment, on keys, pad, touch screen and gamepad together."""

    directions: frozenset[Direction] = frozenset()
    stick: tuple[float, float] = (0.0, 0.0)
    """Forward and left, each in [-1, 1]."""
    is_slow: bool = False

    @property
    def is_empty(self) -> bool:
        """Whether no input is held; a modifier alone does not count."""
        return not self.directions and self.stick == (0.0, 0.0)

    def twist(self) -> Twist:
        """Return the requested velocity; opposite directions cancel out."""
        held = self.directions
        forward = (Direction.FORWARD in held) - (Direction.BACKWARD in held) + self.stick[0]
        left = (Direction.LEFT in held) - (Direction.RIGHT in held) + self.stick[1]
        scale = SLOW_SCALE if self.is_slow else 1.0
        return Twist(_unit(forward) * scale * MAX_LINEAR_M_S, _unit(left) * scale * MAX_ANGULAR_RAD_S)


@dataclass(frozen=True, slots=True)
class DriveAccepted:
    """A driver's input was accepted."""

    client: ClientId
    twist: Twist


@dataclass(frozen=True, slots=True)
class MotionStopped:
    """The motion ended, or a stop was requested while nothing moved."""

    client: ClientId | None
    """The client that caused the stop; None for the app itself."""
    reason: StopReason


SeatEvent: TypeAlias = DriveAccepted | MotionStopped


@dataclass(frozen=True, slots=True)
class SeatState:
    """State of the seat for one client."""

    driver: ClientId | None
    epoch: int
    is_armed: bool
    """Whether the client may drive without letting go first."""
    reason: StopReason | None
    """Reason for the stop that began the present epoch."""
    stopped_by: ClientId | None


class DriverSeat:
    """Decides which client drives, and at which velocity."""

    def __init__(
        self,
        *,
        lease_s: float = LEASE_S,
        hand_limit_s: float = HAND_LIMIT_S,
        idle_s: float = IDLE_S,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.lease_s = lease_s
        self._hand_limit_s = max(hand_limit_s, lease_s)
        self._idle_s = idle_s
        self._clock = clock
        self._lock = threading.RLock()
        self._driver: ClientId | None = None
        self._twist: Twist | None = None
        self._counts_until = self._active = clock()
        self._epoch = 0
        self._armed: set[ClientId] = set()
        self._reason: StopReason | None = None
        self._stopped_by: ClientId | None = None
        self._events: list[SeatEvent] = []
        self._is_kept = False

    @property
    def driver(self) -> ClientId | None:
        """The client that has the seat; None if it is free."""
        with self._lock:
            self._expire()
            return self._driver

    def current_twist(self, now: float | None = None) -> Twist | None:
        """Return the velocity at the time `now` (in seconds of the clock, by default the present); None if no input
        counts."""
        with self._lock:
            self._expire(now)
            return self._twist

    def receive(self, client: ClientId, held: HeldInput, epoch: int, age_s: float = 0.0) -> None:
        """Process a message with the inputs that the client held `age_s` seconds ago, and the epoch that it knows."""
        with self._lock:
            self._expire()
            counts = epoch == self._epoch and age_s < self._hand_limit_s
            if held.is_empty:
                self._let_go(client, arms=counts)
            elif counts and client in self._armed and self.try_sit(client):
                self._drive(client, held.twist(), age_s)
            else:
                # A watcher's held key must not start the robot when the seat becomes free, only a new press may.
                self._armed.discard(client)

    def keep(self, *, kept: bool) -> None:
        """Keep the seat for its driver without input, while an activity that the driver started goes on."""
        with self._lock:
            self._expire()
            if self._is_kept and not kept:
                self._active = self._clock()
            self._is_kept = kept

    def try_sit(self, client: ClientId) -> bool:
        """Take the seat if it is free; return whether the client has it."""
        with self._lock:
            self._expire()
            if self._driver is None:
                self._driver = client
                self._active = self._clock()
            return self._driver == client

    def stop(self, client: ClientId | None = None) -> None:
        """Stop the robot on behalf of a client; None means the app itself."""
        with self._lock:
            self._expire()
            self._begin_epoch(client, StopReason.STOPPED)

    def take_over(self, client: ClientId) -> None:
        """Give the seat to `client`; both must let go of everything before the robot moves again."""
        with self._lock:
            self._expire()
            if self._driver not in (None, client):
                self._begin_epoch(client, StopReason.TAKEN_OVER)
            self._driver = client
            self._active = self._clock()

    def release(self, client: ClientId) -> None:
        """Free the seat if the client has it; a moving robot stops."""
        self._vacate(client, StopReason.GAVE_UP)

    def leave(self, client: ClientId) -> None:
        """Remove a client whose page is gone; if it was driving, the robot stops."""
        self._vacate(client, StopReason.LEFT)
        with self._lock:
            self._armed.discard(client)

    def state_of(self, client: ClientId) -> SeatState:
        """Return the state of the seat for `client`."""
        with self._lock:
            self._expire()
            return SeatState(self._driver, self._epoch, client in self._armed, self._reason, self._stopped_by)

    def next_deadline(self) -> float | None:
        """Return the time of the next expiry in seconds of the clock; None for never."""
        with self._lock:
            if self._twist is not None:
                return self._counts_until
            return None if self._driver is None or self._is_kept else self._active + self._idle_s

    def take_events(self) -> list[SeatEvent]:
        """Return the events since the last call in order, including expiries."""
        with self._lock:
            self._expire()
            events, self._events = self._events, []
            return events

    def _expire(self, now: float | None = None) -> None:
        """Apply all expiries until `now`; every public method calls this first."""
        now = self._clock() if now is None else now
        if self._twist is not None and now >= self._counts_until:
            self._begin_epoch(self._driver, StopReason.INPUT_LOST)
        is_idle = self._twist is None and not self._is_kept and now - self._active >= self._idle_s
        if self._driver is not None and is_idle:
            self._driver = None

    def _drive(self, client: ClientId, twist: Twist, age_s: float) -> None:
        now = self._active = self._clock()
        self._counts_until = now + min(self.lease_s, self._hand_limit_s - age_s)
        late = max(0.0, age_s - self.lease_s)
        share = 1.0 - late / (self._hand_limit_s - self.lease_s) if late else 1.0
        self._twist = Twist(share * twist.linear_m_s, share * twist.angular_rad_s)
        self._events.append(DriveAccepted(client, self._twist))

    def _let_go(self, client: ClientId, *, arms: bool) -> None:
        if arms:
            self._armed.add(client)
        if client == self._driver and self._twist is not None:
            self._twist = None
            self._active = self._clock()
            self._events.append(MotionStopped(client, StopReason.RELEASED))

    def _vacate(self, client: ClientId, reason: StopReason) -> None:
        with self._lock:
            self._expire()
            if client != self._driver:
                return
            if self._twist is not None:
                self._begin_epoch(client, reason)
            self._driver = None

    def _begin_epoch(self, client: ClientId | None, reason: StopReason) -> None:
        self._twist = None
        self._epoch += 1
        self._armed.clear()
        self._reason = reason
        self._stopped_by = client
        self._events.append(MotionStopped(client, reason))


def _unit(value: float) -> float:
    return max(-1.0, min(1.0, value))


HERE_LEASE_S = 0.25
"""Time in seconds without a sign of life after which a page counts as gone."""
TICK_S = 0.02
"""Interval between checks for silent pages, in seconds."""


class Loss(StrEnum):
    """How the last page was lost; the value ends the sentence “The last page ...”."""

    CLOSED = "was closed"
    SILENT = "froze or lost its connection"


@dataclass(frozen=True, slots=True)
class Absence:
    """A time without any open page."""

    loss: Loss
    since: datetime
    """Local time at which the last page was lost."""


class Presence:
    """Tracks the open pages by their signs of life."""

    def __init__(
        self,
        *,
        lease_s: float = HERE_LEASE_S,
        clock: Callable[[], float] = time.monotonic,
        today: Callable[[], datetime] = datetime.now,
    ) -> None:
        """Start without pages; `clock` measures silence in seconds."""
        self._lease_s = lease_s
        self._clock = clock
        self._today = today
        self._heard: dict[ClientId, float] = {}
        self._counted_s = 0.0
        self._ticked = clock()
        self.absence: Absence | None = None
        """The current absence of pages; None while a page is open, and before the first one."""

    def hear(self, client: ClientId) -> None:
        """Record a sign of life of a page."""
        self._heard[client] = self._counted_s
        self.absence = None

    def leave(self, client: ClientId) -> None:
        """Record that a page's socket was closed."""
        was_there = self.absence is None
        self._heard.pop(client, None)
        if was_there and not self.is_somebody_there:
            self.absence = Absence(Loss.CLOSED, self._today())

    def tick(self) -> bool:
        """Update the clock; return whether the last page has just become silent. Must be called every `TICK_S`."""
        now = self._clock()
        # A late call means that this thread stalled and received no signs of life, so that time does not count.
        self._counted_s += min(now - self._ticked, 2 * TICK_S)
        self._ticked = now
        if self.absence is not None or not self._heard or self.is_somebody_there:
            return False
        self.absence = Absence(Loss.SILENT, self._today())
        return True

    @property
    def is_somebody_there(self) -> bool:
        """Whether a page is open. May be read in any thread."""
        return any(self._counted_s - heard <= self._lease_s for heard in list(self._heard.values()))
