"""Motion of the robot during one query, one control step at a time.

Owns the numbers of steps and collisions and their limits. Every step returns control to the caller with a `Tick`.
"""

from collections.abc import Callable, Generator, Iterator
from typing import TypeAlias, TypeVar

import numpy as np

from ltvn_core.config import RecoveryConfig
from ltvn_core.errors import RobotPausedError
from ltvn_core.graph.wheel_slips import SlipTracker
from ltvn_core.navigation.events import Collided, Event, Outcome, Tick
from ltvn_core.robots.robot import Robot
from ltvn_core.types import CONTROL_STEP_S, ZERO_TWIST, Observation, Pose, RobotState, Twist

_T = TypeVar("_T")
EventGenerator: TypeAlias = Generator[Event | Tick, None, _T]
"""Part of a query: yields events and ticks, returns a result."""


class QueryAborted(Exception):
    """The query ended early, because a limit was reached or a person cancelled it."""

    def __init__(self, outcome: Outcome) -> None:
        super().__init__(outcome.value)
        self.outcome = outcome


class MotionExecutor:
    """Drives the robot for one query."""

    def __init__(self, robot: Robot, query: int, limits: RecoveryConfig, *, slips: SlipTracker | None = None) -> None:
        """Start counting at zero; `slips` corrects odometry where images contradict it."""
        self._robot = robot
        self._query = query
        self._limits = limits
        self._slips = slips
        self._state = self._mended(robot.state())
        self.steps = 0
        self._uncounted = 0
        self.collisions = 0
        self.path_m = 0.0
        self.cancelled = False

    @property
    def odometry(self) -> Pose:
        """(3,) pose of the robot in the odometry frame."""
        return self._state.odometry

    @property
    def stamp(self) -> float:
        """Time of the last state, in seconds on the robot's clock."""
        return self._state.stamp

    @property
    def in_collision(self) -> bool:
        """Whether the bumper is in contact."""
        return self._state.bumper_pressed

    def observe(self) -> Observation:
        """Take an observation now; correct odometry if the observation shows that the wheels slipped."""
        while True:
            try:
                seen = self._robot.observe()
                break
            except RobotPausedError:  # After a pause of this program, stand still until the robot obeys again.
                self._robot.stop()
                self._robot.clock.advance(CONTROL_STEP_S)
        if self._slips is None:
            return seen
        seen = self._slips.see(seen)
        self._state = self._state._replace(odometry=self._mended(self._robot.state()).odometry)
        return seen

    def stop(self) -> None:
        """Stop now."""
        self._robot.stop()

    def move(self, twist: Twist) -> Iterator[Event | Tick]:
        """Command a velocity for one control step; raise QueryAborted at a limit."""
        if self.cancelled:
            raise QueryAborted(Outcome.CANCELLED)
        if self.steps - self._uncounted >= self._limits.step_limit:
            raise QueryAborted(Outcome.STEP_LIMIT)
        self._robot.drive(twist)
        yield Tick()
        felt = self._robot.state()
        before, self._state = self._state, self._mended(felt)
        self.steps += 1
        self.path_m += float(np.hypot(*(self._state.odometry - before.odometry)[:2]))
        if self._state.bumper_pressed and not before.bumper_pressed:
            self.collisions += 1
            yield Collided(self._query, self.collisions)
        if self.collisions > self._limits.collision_limit:
            raise QueryAborted(Outcome.COLLISION_LIMIT)
        if self._slips is not None and self._slips.needs_image(felt.odometry):
            self.observe()

    def wait_one_step(self) -> Iterator[Event | Tick]:
        """Stand still for one control step.

        The step counts against the step limit, so that no loop is endless.
        """
        yield from self.move(ZERO_TWIST)

    def stand_by(self) -> Iterator[Event | Tick]:
        """Let one control step pass while the robot may be carried.

        It counts neither against the step limit nor as driven distance.
        """
        driven_m = self.path_m
        self._uncounted += 1
        yield from self.move(ZERO_TWIST)
        self.path_m = driven_m

    def drive_straight(
        self, length_m: float, speed_m_s: float, *, goes_on: Callable[[], bool] = lambda: True
    ) -> Iterator[Event | Tick]:
        """Drive straight by a length, backwards if negative; stop at a collision, or when `goes_on` returns False."""
        start = self.path_m
        for _ in range(2 + int(2 * abs(length_m) / (speed_m_s * CONTROL_STEP_S))):
            if self.path_m - start >= abs(length_m) or not goes_on():
                return
            collisions_before = self.collisions
            yield from self.move(Twist(float(np.sign(length_m) * speed_m_s), 0.0))
            if self.collisions > collisions_before:
                return

    def _mended(self, state: RobotState) -> RobotState:
        """Return a state of the robot with odometry corrected for wheel slips."""
        return state if self._slips is None else state._replace(odometry=self._slips.mended(state.odometry))
