"""The position-based feedback controller: waypoint error in, velocities out. Pure functions.

Turns towards the target, drives with heading correction, then turns to the final yaw. An edge that is driven against
its direction has its target behind the robot, which then backs up along the same waypoint. Knows no images.
"""

import numpy as np

from ltvn_core.config import DrivingConfig
from ltvn_core.geometry import wrap_angle
from ltvn_core.types import Twist, Waypoint

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
