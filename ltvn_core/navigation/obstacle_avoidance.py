"""Obstacle avoidance: bends a command that would end in contact, or refuses it. Pure functions.

Owns the short arcs that the robot can drive next. Plans nothing beyond their horizon.
"""

import numpy as np
from numpy.typing import NDArray

from ltvn_core.config import DrivingConfig
from ltvn_core.navigation.clearances import MAX_NOISE_POINTS, NARROW_MARGIN_M, Clearances
from ltvn_core.navigation.steering import TURN_RAD_S
from ltvn_core.types import Twist

_MARGIN_M = 0.04
"""Clearance kept on each side of the robot, in metres."""
_HORIZON_S = 0.8
_STEPS = 6
_TURN_OFFSETS_RAD_S = (0.0, 0.3, -0.3, 0.6, -0.6, 0.9, -0.9)
"""Changes of the turning rate that are tried, the smallest first."""
_NARROW_SPEED_FACTOR = 0.4
_NARROW_REACH_M = 0.12
"""Distance in metres within which a slow command may hit nothing, if the robot follows a way through a gap. The way
bends, so no command is right for longer."""


def collision_free_command(
    twist: Twist,
    points: NDArray[np.float64],
    length_m: float,
    config: DrivingConfig,
    *,
    radius_m: float,
    is_narrow: bool = False,
) -> Twist | None:
    """Return the command nearest to `twist` that hits none of the points (M, 2) within `length_m`.

    Points are in the robot's frame. `is_narrow` means that a free way through a gap is known. Returns None if every arc
    ends in contact; a turn on the spot never does.
    """
    if not twist.linear_m_s or len(points) <= MAX_NOISE_POINTS:
        return twist
    clearances = Clearances(points)
    clear_m, narrow_m = (clearances.least_m(radius_m + margin) for margin in (_MARGIN_M, NARROW_MARGIN_M))
    reach_m = min(length_m, abs(twist.linear_m_s) * _HORIZON_S)
    for turn_offset in _TURN_OFFSETS_RAD_S if config.swerve else _TURN_OFFSETS_RAD_S[:1]:
        turn = float(np.clip(twist.angular_rad_s + turn_offset, -TURN_RAD_S, TURN_RAD_S))
        # A bent command is slower, because the robot needs time to see what comes into view.
        adjusted = Twist(twist.linear_m_s * (1 - 0.5 * abs(turn_offset) / TURN_RAD_S), turn)
        if clearances.at(_arc(adjusted, reach_m)).min() > clear_m:
            return adjusted
    slow = Twist(twist.linear_m_s * _NARROW_SPEED_FACTOR, twist.angular_rad_s)
    if is_narrow:
        reach_m = min(reach_m, _NARROW_REACH_M)
    return slow if clearances.at(_arc(slow, reach_m)).min() > narrow_m else None


def _arc(twist: Twist, reach_m: float) -> NDArray[np.float64]:
    """Return (_STEPS, 2) places along the arc of a command."""
    seconds = reach_m / abs(twist.linear_m_s)
    yaw = twist.angular_rad_s * seconds * np.arange(1, _STEPS + 1) / _STEPS
    along = twist.linear_m_s * seconds * np.arange(1, _STEPS + 1) / _STEPS
    # A chord of the circle: as long as the arc times sinc, and turned by half its angle.
    chord = along * np.sinc(yaw / (2 * np.pi))
    return np.stack([chord * np.cos(yaw / 2), chord * np.sin(yaw / 2)], axis=-1)
