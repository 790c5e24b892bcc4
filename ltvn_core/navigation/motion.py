"""The robot during one query: moves one control step at a time and counts steps, metres and collisions.

Owns the counts and their limits. Every step hands control back to the caller with a `Tick`.
"""

from collections.abc import Callable, Generator, Iterator
from typing import TypeAlias, TypeVar

import numpy as np

from ltvn_core.config import RecoveryConfig
from ltvn_core.geometry import wrap_angle
from ltvn_core.navigation.events import Collided, Event, Outcome, Tick
from ltvn_core.robots.robot import Robot
from ltvn_core.types import CONTROL_STEP_S, ZERO_TWIST, Observation, Pose, Twist

_T = TypeVar("_T")
EventGenerator: TypeAlias = Generator[Event | Tick, None, _T]
"""Part of a query: yields events and ticks, returns a result."""


class QueryAborted(Exception):
    """A limit was hit, or a person took over, in the middle of something."""

    def __init__(self, outcome: Outcome) -> None:
        super().__init__(outcome.value)
        self.outcome = outcome


class MotionExecutor:
    """Drives the robot for one query."""

    def __init__(self, robot: Robot, query: int, limits: RecoveryConfig) -> None:
        """Count from zero."""
        self._robot = robot
        self._query = query
        self._limits = limits
        self._state = robot.state()
        self.steps = 0
        self.collisions = 0
        self.path_m = 0.0
        self.cancelled = False

    @property
    def odometry(self) -> Pose:
        """(3,) in the odometry frame."""
        return self._state.odometry

    @property
    def stamp(self) -> float:
        """Seconds on the robot's clock."""
        return self._state.stamp

    @property
    def in_collision(self) -> bool:
        """The bumper is in contact."""
        return self._state.bumper_pressed

    def observe(self) -> Observation:
        """Take an observation now."""
        return self._robot.observe()

    def stop(self) -> None:
        """Stop now."""
        self._robot.stop()

    def move(self, twist: Twist) -> Iterator[Event | Tick]:
        """Command a velocity for one control step; raise QueryAborted at a limit."""
        if self.cancelled:
            raise QueryAborted(Outcome.CANCELLED)
        if self.steps >= self._limits.step_limit:
            raise QueryAborted(Outcome.STEP_LIMIT)
        self._robot.drive(twist)
        yield Tick()
        yield from self._update_state()

    def wait_one_step(self) -> Iterator[Event | Tick]:
        """Stand still for one control step, so that no loop of thoughts is endless."""
        yield from self.move(ZERO_TWIST)

    def turn(self, angle_rad: float, rate_rad_s: float) -> Iterator[Event | Tick]:
        """Turn on the spot by an angle, by odometry."""
        start, sign = self.odometry[2], np.sign(angle_rad)
        # Odometry may stand still when the robot is stuck, so the number of steps is bounded too.
        for _ in range(2 + int(2 * abs(angle_rad) / (rate_rad_s * CONTROL_STEP_S))):
            left = abs(float(wrap_angle(start + angle_rad - self.odometry[2])))
            if left < 0.05:
                return
            yield from self.move(Twist(0.0, float(sign * min(rate_rad_s, max(0.2, left / CONTROL_STEP_S)))))

    def drive_straight(
        self, length_m: float, speed_m_s: float, *, goes_on: Callable[[], bool] = lambda: True
    ) -> Iterator[Event | Tick]:
        """Drive straight by a length, backwards if negative, until a collision; `goes_on` is asked before each step."""
        start = self.path_m
        for _ in range(2 + int(2 * abs(length_m) / (speed_m_s * CONTROL_STEP_S))):
            if self.path_m - start >= abs(length_m) or not goes_on():
                return
            collisions_before = self.collisions
            yield from self.move(Twist(float(np.sign(length_m) * speed_m_s), 0.0))
            if self.collisions > collisions_before:
                return

    def _update_state(self) -> Iterator[Event]:
        before, self._state = self._state, self._robot.state()
        self.steps += 1
        self.path_m += float(np.hypot(*(self._state.odometry - before.odometry)[:2]))
        if self._state.bumper_pressed and not before.bumper_pressed:
            self.collisions += 1
            yield Collided(self._query, self.collisions)
        if self.collisions > self._limits.collision_limit:
            raise QueryAborted(Outcome.COLLISION_LIMIT)
