"""The robot interface: what the session, the command line and the navigator need of a robot.

Owns the Protocols `Robot` and `Clock`; `WallClock`, the clock of every real robot; and the reason why a robot does not
obey commands, as a replayed recording does not. A robot of your own implements `Robot`;
`ltvn_core.robots.robot_view.fit_camera` adapts its camera to any predictor.
"""

import time
from collections.abc import Callable
from typing import Protocol

from ltvn_core.robots.robot_spec import RobotSpec
from ltvn_core.types import Observation, RobotState, Twist


class Clock(Protocol):
    """Clock of a robot: simulated time passes only in `advance`, real time by itself."""

    @property
    def is_simulated(self) -> bool:
        """Whether time passes only in `advance`, which may be faster than real time."""
        ...

    def now(self) -> float:
        """Return the seconds on the robot's clock."""
        ...

    def advance(self, duration_s: float) -> None:
        """Let `duration_s` pass since the last call: a simulator computes it, and a real clock waits for the rest of
        it."""
        ...


class WallClock:
    """Real time. Implements `Clock`.

    A loop that calls `advance` with its period runs at that rate, because the time of its own work counts. The delay of
    an iteration that took too long is not made up for.
    """

    is_simulated = False

    def __init__(
        self, monotonic: Callable[[], float] = time.monotonic, sleep: Callable[[float], None] = time.sleep
    ) -> None:
        """Start at 0 s. Tests pass their own `monotonic` and `sleep`."""
        self._monotonic = monotonic
        self._sleep = sleep
        self._start_s = monotonic()
        self._due_s = 0.0

    def now(self) -> float:
        """Return the seconds since the clock was created."""
        return self._monotonic() - self._start_s

    def advance(self, duration_s: float) -> None:
        """Wait until `duration_s` have passed since the last call returned; return at once if they have passed
        already."""
        self._due_s += duration_s
        left_s = self._due_s - self.now()
        if left_s > 0:
            self._sleep(left_s)
        else:
            self._due_s = self.now()


class Robot(Protocol):
    """A body with a camera that can be driven.

    A drive command is a lease (`ltvn_core.robots.drive_lease`): it expires by itself, and then the robot stops.
    """

    @property
    def spec(self) -> RobotSpec:
        """The robot's size, speeds and camera; `spec.camera` takes the images that `observe` returns."""
        ...

    @property
    def clock(self) -> Clock:
        """The clock of all its stamps."""
        ...

    def observe(self) -> Observation:
        """Take an image now, or return the one already taken in this control step."""
        ...

    def state(self) -> RobotState:
        """Return odometry, time and bumper without taking an image; may be called from any thread."""
        ...

    def drive(self, twist: Twist) -> None:
        """Command a velocity until the lease expires or the next command; may be called from any thread."""
        ...

    def stop(self) -> None:
        """Stop now and stand still until the next `drive`; may be called from any thread."""
        ...


def open_loop_word(robot: object) -> str:
    """Return a sentence with the reason why a robot does not obey commands; empty if it obeys.

    A robot of your own may provide it as an attribute `open_loop`.
    """
    return str(getattr(robot, "open_loop", ""))
