"""Steering: velocities towards a waypoint that the robot's body can drive.

A robot that turns on the spot follows `steer` directly. A car (Ackermann steering) has a minimum turning radius:
instead of turning on the spot, it drives short arcs forwards and backwards, as a driver does in a narrow street.
Computes commands only; moves nothing.
"""

from collections.abc import Iterator

import numpy as np

from ltvn_core.config import DrivingConfig
from ltvn_core.geometry import wrap_angle
from ltvn_core.robots.robot_spec import SpeedLimits
from ltvn_core.types import Pose, Twist, Waypoint

TURN_RAD_S = 1.0
"""Maximum turning rate, in rad/s."""
REACHED_M, REACHED_RAD = 0.08, 0.06
"""Distance within which a waypoint is reached, and greatest heading error at the end of the final turn."""
_REVERSE_BEARING_RAD = float(np.deg2rad(100))
_TURN_FIRST_RAD = 0.5
"""Bearing beyond which the robot turns on the spot before it drives."""
_TURN_FIRST_IN_NARROW_RAD = 0.15
"""The same in a narrow way, where an arc would touch its side."""
_PASSED_M = 0.2
"""Distance within which a target on the other side of the robot counts as passed, in metres."""
_SLOW_DOWN_M = 0.2
_BEARING_GAIN_1_S = 3.0
_YAW_GAIN_1_S = 4.0
_ARC_M_S = 0.25
"""Speed on the short arcs of a turn."""
_ARC_M = 0.15
"""Length of each arc, in metres; the next arc goes in the opposite direction."""
_AIMED_RAD = 0.1
"""Bearing at which a turn by arcs ends."""
_CAR_LEGS = 4


def drives_backwards(waypoint: Waypoint) -> bool:
    """Tell whether the robot backs up to reach a waypoint (3,)."""
    bearing = np.arctan2(waypoint[1], waypoint[0])
    return bool(abs(bearing) > _REVERSE_BEARING_RAD)


def steer(
    error: Waypoint,
    config: DrivingConfig,
    *,
    backwards: bool,
    turn_first_rad: float = _TURN_FIRST_RAD,
    reached_m: float = REACHED_M,
) -> Twist | None:
    """Return the velocities towards a target given in the robot's frame (3,); None once it is reached."""
    away_m = float(np.hypot(error[0], error[1]))
    ahead_m = -error[0] if backwards else error[0]
    if away_m < reached_m or (away_m < _PASSED_M and ahead_m < 0):
        return _turn_to(float(error[2]))
    bearing = float(np.arctan2(error[1], error[0]))
    if backwards:
        bearing = float(wrap_angle(bearing + np.pi))
    turn = _limited(_BEARING_GAIN_1_S * bearing)
    if abs(bearing) > turn_first_rad:
        return Twist(0.0, turn)
    # The fourth power keeps the robot from cutting corners: it hardly moves before it faces the target.
    speed = config.speed_m_s * np.cos(bearing) ** 4 * min(1.0, away_m / _SLOW_DOWN_M + 0.2)
    return Twist(float(-speed if backwards else speed), turn)


class TurningCircle:
    """Commands that a body can drive in place of a desired one. Remembers the current arc of a turn."""

    def __init__(self, limits: SpeedLimits) -> None:
        """Steer a body with these limits."""
        self._limits = limits
        self._forwards = True
        self._arc_began: Pose | None = None

    @property
    def legs(self) -> int:
        """Largest factor by which this body takes longer than one that turns on the spot."""
        return _CAR_LEGS if self._limits.turning_radius_m else 1

    def steer(
        self,
        error: Waypoint,
        config: DrivingConfig,
        *,
        backwards: bool,
        is_narrow: bool = False,
        reached_m: float = REACHED_M,
    ) -> Twist | None:
        """Return the velocities of `steer`, adapted to the turning radius.

        A turn that has begun goes on until the target is straight ahead, although its arcs move the body. If the way
        `is_narrow`, a robot that can turns on the spot rather than in an arc.
        """
        radius_m = self._limits.turning_radius_m
        if not radius_m:
            turn_first_rad = _TURN_FIRST_IN_NARROW_RAD if is_narrow else _TURN_FIRST_RAD
            return steer(error, config, backwards=backwards, turn_first_rad=turn_first_rad, reached_m=reached_m)
        away_m = float(np.hypot(error[0], error[1]))
        turns = self._arc_began is not None
        # The arc to a point at distance d and bearing b has the radius d / (2 sin b).
        first_rad = _AIMED_RAD if turns else 0.8 * np.arcsin(min(away_m / (2 * radius_m), 0.6))
        slack_m = 2 * _ARC_M if turns else _ARC_M / 2
        reached_m += slack_m
        return steer(error, config, backwards=backwards, turn_first_rad=float(first_rad), reached_m=reached_m)

    def commands(self, wish: Twist, odometry: Pose) -> Iterator[Twist]:
        """Yield commands to try in place of a desired one, the best first; a drivable one stays as it is.

        Args:
            wish: Desired command, for a body that turns on the spot.
            odometry: (3,) current pose of the body in the odometry frame.
        """
        if wish.linear_m_s or not wish.angular_rad_s or not self._limits.turning_radius_m:
            self._arc_began = None
            yield self._limits.curved(wish)
            return
        began = self._arc_began
        if began is None:
            self._arc_began = odometry
        elif np.hypot(*(odometry - began)[:2]) >= _ARC_M:
            self._turn_back(odometry)
        yield self._arc(wish)
        self._turn_back(odometry)
        yield self._arc(wish)

    def _turn_back(self, odometry: Pose) -> None:
        self._forwards = not self._forwards
        self._arc_began = odometry

    def _arc(self, wish: Twist) -> Twist:
        """Return the tightest arc in the desired turning direction; backwards, the wheels point to the other side."""
        radius_m = self._limits.turning_radius_m
        speed = min(_ARC_M_S, abs(wish.angular_rad_s) * radius_m)
        return Twist(speed if self._forwards else -speed, float(np.sign(wish.angular_rad_s)) * speed / radius_m)


def _turn_to(yaw_rad: float) -> Twist | None:
    return None if abs(yaw_rad) < REACHED_RAD else Twist(0.0, _limited(_YAW_GAIN_1_S * yaw_rad))


def _limited(rate_rad_s: float) -> float:
    return float(np.clip(rate_rad_s, -TURN_RAD_S, TURN_RAD_S))
