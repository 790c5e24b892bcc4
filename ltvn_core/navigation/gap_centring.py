"""Gap centring: leads the robot along the middle of a narrow way, instead of straight to its waypoint.

Owns the choice of a way within the next metre. Pure functions. `navigation.obstacle_avoidance` still checks each
command, and `navigation.detour` plans around what closes the way.
"""

import numpy as np
from numpy.typing import NDArray

from ltvn_core.navigation.clearances import NARROW_MARGIN_M, Clearances

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
