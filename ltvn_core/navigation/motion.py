"""Motion of the robot during one query: turns a waypoint error into velocities, one control step at a time, and counts.

Owns the counts and their limits. Every step returns control to the caller with a `Tick`.
"""

from collections.abc import Callable, Generator, Iterator
from typing import TypeAlias, TypeVar

import numpy as np

from ltvn_core.config import DrivingConfig, RecoveryConfig
from ltvn_core.geometry import wrap_angle
from ltvn_core.graph.wheel_slips import SlipTracker
from ltvn_core.navigation.events import Collided, Event, Outcome, Tick
from ltvn_core.robots.robot import Robot
from ltvn_core.types import CONTROL_STEP_S, ZERO_TWIST, Observation, Pose, RobotState, Twist, Waypoint

_REVERSE_BEARING_RAD = float(np.deg2rad(100))
_TURN_FIRST_RAD = 0.5
"""Beyond this bearing the robot turns on the spot."""
_PASSED_M = 0.2
"""A target this near that slips to the other side has been passed, not missed."""
_SLOW_DOWN_M = 0.2
_BEARING_GAIN_1_S = 3.0
_YAW_GAIN_1_S = 4.0


def drives_backwards(waypoint: Waypoint) -> bool:
    """Tell whether the robot backs up to reach a waypoint (3,)."""
    bearing = np.arctan2(waypoint[1], waypoint[0])
    return bool(abs(bearing) > _REVERSE_BEARING_RAD)


def steer(error: Waypoint, config: DrivingConfig, *, backwards: bool) -> Twist | None:
    """Return the velocities towards a target given in the robot's frame (3,); None once it is reached."""
    away_m = float(np.hypot(error[0], error[1]))
    ahead_m = -error[0] if backwards else error[0]
    there = away_m < config.position_tolerance_m or (away_m < _PASSED_M and ahead_m < 0)
    return _turn_to(float(error[2]), config) if there else _drive_to(error, away_m, config, backwards=backwards)


def _turn_to(yaw_rad: float, config: DrivingConfig) -> Twist | None:
    if abs(yaw_rad) < config.yaw_tolerance_rad:
        return None
    return Twist(0.0, _limited(_YAW_GAIN_1_S * yaw_rad, config.turn_rad_s))


def _drive_to(error: Waypoint, away_m: float, config: DrivingConfig, *, backwards: bool) -> Twist:
    bearing = float(np.arctan2(error[1], error[0]))
    if backwards:
        bearing = float(wrap_angle(bearing + np.pi))
    turn = _limited(_BEARING_GAIN_1_S * bearing, config.turn_rad_s)
    if abs(bearing) > _TURN_FIRST_RAD:
        return Twist(0.0, turn)
    # The fourth power keeps the robot from cutting corners: it hardly moves before it faces its way.
    speed = config.speed_m_s * np.cos(bearing) ** 4 * min(1.0, away_m / _SLOW_DOWN_M + 0.2)
    return Twist(float(-speed if backwards else speed), turn)


def _limited(value: float, limit: float) -> float:
    return float(np.clip(value, -limit, limit))


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

    def __init__(self, robot: Robot, query: int, limits: RecoveryConfig, *, slips: SlipTracker | None = None) -> None:
        """Start counting at zero; `slips` corrects odometry where images contradict it."""
        self._robot = robot
        self._query = query
        self._limits = limits
        self._slips = slips
        self._state = self._mended(robot.state())
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
        """Take an observation now, which may tell that the wheels have slipped."""
        seen = self._robot.observe()
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
        start = self.odometry[2]
        sign = np.sign(angle_rad)
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

    def _mended(self, state: RobotState) -> RobotState:
        """Return a state of the robot with corrected odometry."""
        return state if self._slips is None else state._replace(odometry=self._slips.mended(state.odometry))
