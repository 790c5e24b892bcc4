"""The robot boundary: all that the session, the command line and the navigator need of a robot.

Owns the Protocols `Robot` and `Clock`, `WallClock`, the clock of every robot that is not simulated, and how a robot
that shows what was recorded says that it obeys no command. A robot of one's own implements `Robot`;
`ltvn_core.robots.robot_view.fit_camera` lets any predictor look through its camera.
"""

import time
from collections.abc import Callable
from typing import Protocol

from ltvn_core.errors import OptionError
from ltvn_core.robots.robot_spec import RobotSpec
from ltvn_core.types import Observation, RobotState, Twist


class Clock(Protocol):
    """How a robot's time passes: a simulator's moves when it is told to, the wall's by itself."""

    @property
    def is_simulated(self) -> bool:
        """Whether time stands still until `advance`, and can pass faster than on the wall."""
        ...

    def now(self) -> float:
        """Return the seconds on the robot's clock."""
        ...

    def advance(self, duration_s: float) -> None:
        """Let time pass since the last call: a simulator computes it, the wall's clock waits for what is left of it."""
        ...


class WallClock:
    """Time that passes by itself. Implements `Clock`.

    A loop that calls `advance` with the length of its turn runs at that rate: its own work counts, and a turn that
    took too long is not made up for.
    """

    is_simulated = False

    def __init__(
        self, monotonic: Callable[[], float] = time.monotonic, sleep: Callable[[float], None] = time.sleep
    ) -> None:
        """Begin at 0 s. Tests hand in their own `monotonic` and `sleep`."""
        self._monotonic = monotonic
        self._sleep = sleep
        self._start_s = monotonic()
        self._due_s = 0.0

    def now(self) -> float:
        """Return the seconds since the clock was made."""
        return self._monotonic() - self._start_s

    def advance(self, duration_s: float) -> None:
        """Wait until `duration_s` have passed since the last call returned; not at all if they have already."""
        self._due_s += duration_s
        left_s = self._due_s - self.now()
        if left_s > 0:
            self._sleep(left_s)
        else:
            self._due_s = self.now()


class Robot(Protocol):
    """A body with a camera that can be driven.

    A drive command is a lease (`ltvn_core.robots.drive_lease`): it runs out by itself, and then the robot stops once.
    """

    @property
    def spec(self) -> RobotSpec:
        """Its size, speeds and camera; `spec.camera` takes the images that `observe` returns."""
        ...

    @property
    def clock(self) -> Clock:
        """The clock of all its stamps."""
        ...

    def observe(self) -> Observation:
        """Take an image now, or return the one already taken in this control step."""
        ...

    def state(self) -> RobotState:
        """Return odometry, clock and bumper without taking an image; may be asked from any thread."""
        ...

    def drive(self, twist: Twist) -> None:
        """Command a velocity until the lease runs out or the next command; may come from any thread."""
        ...

    def stop(self) -> None:
        """Stop now; nothing moves until the next `drive`. May come from any thread."""
        ...


def open_loop_word(robot: object) -> str:
    """Return in a sentence why a robot obeys no command; empty where it does.

    A robot of one's own may offer it as an attribute `open_loop`.
    """
    return str(getattr(robot, "open_loop", ""))


def require_drivable(robot: object) -> None:
    """Raise OptionError where a robot obeys no command: nobody learns anything from driving it."""
    if word := open_loop_word(robot):
        raise OptionError(word)
