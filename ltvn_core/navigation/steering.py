"""Steering: velocities towards a waypoint that the robot's body can drive, around obstacles. Moves nothing.

A robot that turns on the spot follows `steer` directly. A car (Ackermann steering) has a minimum turning radius:
instead of turning on the spot, it drives short arcs forwards and backwards, as a driver does in a narrow street.
Three pure functions keep clear of obstacles: `drivable_aim` leads along the middle of a narrow way within the next
metre, `collision_free_command` bends a command that would end in contact, or refuses it, and `find_detour` plans a way
over one via point.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ltvn_core.config import DrivingConfig
from ltvn_core.geometry import wrap_angle
from ltvn_core.navigation.obstacle_memory import MAX_NOISE_POINTS, NARROW_MARGIN_M, Clearances
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
        yaw_rad = float(error[2])
        return None if abs(yaw_rad) < REACHED_RAD else Twist(0.0, _limited(_YAW_GAIN_1_S * yaw_rad))
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


def _limited(rate_rad_s: float) -> float:
    return float(np.clip(rate_rad_s, -TURN_RAD_S, TURN_RAD_S))


_COMFORT_MARGIN_M = 0.12
"""Clearance beside the robot below which a way is narrow, in metres."""
_AHEAD_M, _SPACING_M = 0.8, 0.05
"""Length of the way that is planned, and the spacing of its places, in metres."""
_ASIDE_M = np.linspace(-0.2, 0.2, 41)
"""Distances of these places from the straight line to the waypoint, in metres, positive to the left."""
_END_ASIDE_M = 0.06
"""Greatest such distance at the waypoint itself."""
_BENDS = np.arange(-4, 5)
"""Changes of that distance from one place to the next, in steps of a centimetre."""
_AIM_M = 0.2
"""Distance of the place on the way that the robot steers to, in metres; a nearer waypoint is driven to directly."""
_ASIDE_COST, _BEND_COST = 100.0, 0.1
"""Costs of a metre off the straight line, squared, and of a centimetre of bending, squared. A centimetre of missing
clearance costs 1."""
_TURNS = np.linspace(-np.pi, np.pi, 24, endpoint=False)
_AROUND_M = np.arange(0.02, 0.26, 0.02)[:, None, None] * np.stack([np.cos(_TURNS), np.sin(_TURNS)], axis=-1)
"""Places (R, T, 2) around a waypoint, relative to it, in metres."""
_BESIDE_MARGIN_M, _BESIDE_COST = 0.06, 5.0
"""Preferred clearance of a waypoint that is moved, and the cost of each metre that is missing, in metres of moving."""


def drivable_aim(
    waypoint: NDArray[np.float64], points: NDArray[np.float64], *, radius_m: float
) -> tuple[NDArray[np.float64], bool]:
    """Return the place (2,) to steer to on the way to a waypoint (2,), and whether the way there is narrow.

    Everything is in the robot's frame; `points` (M, 2) are obstacles. A waypoint is only a prediction: one that lies in
    an obstacle is moved out of it.
    """
    clearances = Clearances(points)
    aim = _out_of_obstacles(waypoint, clearances, radius_m)
    length_m = float(np.hypot(*aim))
    is_ahead = abs(aim[1]) <= aim[0]
    way = _centred_way(aim, length_m, clearances, radius_m) if is_ahead and length_m >= _AIM_M else None
    return (aim, False) if way is None else (way[min(round(_AIM_M / _SPACING_M), len(way)) - 1], True)


def _out_of_obstacles(aim: NDArray[np.float64], clearances: Clearances, radius_m: float) -> NDArray[np.float64]:
    """Return the best free place (2,) close to a waypoint (2,) in an obstacle; the waypoint itself without any."""
    least_m = radius_m + NARROW_MARGIN_M
    if clearances.at(aim) >= least_m:
        return aim
    places = (aim + _AROUND_M).reshape(-1, 2)
    clear_m = clearances.at(places)
    missing_m = np.maximum(radius_m + _BESIDE_MARGIN_M - clear_m, 0.0)
    cost = np.linalg.norm(places - aim, axis=-1) + _BESIDE_COST * missing_m
    cost[clear_m < least_m] = np.inf
    return places[cost.argmin()] if np.isfinite(cost).any() else aim


def _centred_way(
    aim: NDArray[np.float64], length_m: float, clearances: Clearances, radius_m: float
) -> NDArray[np.float64] | None:
    """Return places (K, 2) of the way with the most clearance; None if the straight line is comfortable or no way is
    free."""
    along_m = np.arange(1, round(min(length_m, _AHEAD_M) / _SPACING_M) + 1) * _SPACING_M
    ahead = aim / length_m
    left = np.array([-ahead[1], ahead[0]])
    places = along_m[:, None, None] * ahead + _ASIDE_M[:, None] * left
    clear_m = clearances.at(places)
    missing_m = np.maximum(radius_m + _COMFORT_MARGIN_M - clear_m, 0.0)
    if not missing_m[:, len(_ASIDE_M) // 2].any():
        return None
    least_m = np.where(along_m <= _AIM_M, clearances.least_m(radius_m + NARROW_MARGIN_M), radius_m + NARROW_MARGIN_M)
    cost = (100 * missing_m) ** 2 + _ASIDE_COST * _ASIDE_M**2
    cost[clear_m <= least_m[:, None]] = np.inf
    if length_m <= _AHEAD_M:
        cost[-1, np.abs(_ASIDE_M) > _END_ASIDE_M] = np.inf
    columns = _cheapest_columns(cost)
    return None if columns is None else places[np.arange(len(along_m)), columns]


def _cheapest_columns(cost: NDArray[np.float64]) -> NDArray[np.intp] | None:
    """Return the columns (K,) of the cheapest way down costs (K, J) from the middle of the top; None if none is finite.

    Dynamic programming: the cheapest way to a place goes over the cheapest way to one of its predecessors.
    """
    rows, width = cost.shape
    total = np.where(np.arange(width) == width // 2, 0.0, np.inf)
    predecessors = np.zeros(cost.shape, np.intp)
    for row in range(rows):
        padded = np.pad(total, _BENDS[-1], constant_values=np.inf)
        before = np.lib.stride_tricks.sliding_window_view(padded, len(_BENDS)) + _BEND_COST * _BENDS**2
        best = before.argmin(axis=1)
        predecessors[row] = np.clip(np.arange(width) + _BENDS[best], 0, width - 1)
        total = before[np.arange(width), best] + cost[row]
    if not np.isfinite(total).any():
        return None
    columns = np.zeros(rows, np.intp)
    columns[-1] = total.argmin()
    for row in range(rows - 1, 0, -1):
        columns[row - 1] = predecessors[row, columns[row]]
    return columns


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


_DETOUR_RANGES_M = np.array([0.1, 0.2, 0.3, 0.45, 0.6, 0.8])
_DETOUR_BEARINGS_RAD = np.deg2rad(np.arange(-120.0, 121.0, 10.0))
"""Bearings of via points relative to the waypoint's; limited, because the area behind the robot is unseen."""
_GOAL_OFFSETS_M = np.array([0.0, 0.03, -0.03, 0.06, -0.06])
"""Sideways offsets of the end of a path from the waypoint, in metres, because the waypoint is only a prediction."""
_DETOUR_MARGIN_M = 0.06
"""Preferred clearance beside the robot on a detour, in metres."""
_CLEARANCE_COST = 20.0
"""Cost of each metre of missing clearance, in metres of path."""


def find_detour(
    goal: NDArray[np.float64], points: NDArray[np.float64], *, radius_m: float
) -> NDArray[np.float64] | None:
    """Return the via point (2,) of the best way to a waypoint (2,); None if no single via point leads there.

    All points are in the robot's frame; `points` (M, 2) are obstacles.
    """
    if len(points) <= MAX_NOISE_POINTS:
        return None
    clearances = Clearances(points)
    places, ends = _candidates(goal)
    ways = len(places) // len(_GOAL_OFFSETS_M)  # The path to the via point does not depend on the end of the path.
    first_m = np.tile(clearances.of_lines(np.zeros((ways, 2)), places[:ways]), len(_GOAL_OFFSETS_M))
    open_at_first = first_m > clearances.least_m(radius_m + NARROW_MARGIN_M)
    if not open_at_first.any():
        return None
    second_m = np.zeros_like(first_m)
    second_m[open_at_first] = clearances.of_lines(places[open_at_first], ends[open_at_first])
    possible = open_at_first & (second_m > radius_m + NARROW_MARGIN_M)
    if not possible.any():
        return None
    length_m = np.linalg.norm(places, axis=-1) + np.linalg.norm(ends - places, axis=-1)
    tight_m = np.maximum(radius_m + _DETOUR_MARGIN_M - np.minimum(first_m, second_m), 0.0)
    cost = np.where(possible, length_m + _CLEARANCE_COST * tight_m, np.inf)
    return places[int(cost.argmin())]


def _candidates(goal: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (C, 2) via points and the (C, 2) ends of the ways over them."""
    away_m, bearing = (
        part.ravel() for part in np.meshgrid(_DETOUR_RANGES_M, np.arctan2(goal[1], goal[0]) + _DETOUR_BEARINGS_RAD)
    )
    places = away_m[:, None] * np.stack([np.cos(bearing), np.sin(bearing)], axis=-1)
    onward = goal - places
    length_m = np.maximum(np.linalg.norm(onward, axis=-1), 0.01)
    aside = np.stack([-onward[:, 1], onward[:, 0]], axis=-1) / length_m[:, None]
    ends = goal + _GOAL_OFFSETS_M[:, None, None] * aside
    return np.tile(places, (len(_GOAL_OFFSETS_M), 1)), ends.reshape(-1, 2)
