"""Detours: ways over one via point around obstacles between the robot and its waypoint. Pure functions.

Owns which via points are tried, and which of the ways over them is best. Steering around obstacles close ahead is in
`navigation.obstacle_avoidance`.
"""

import numpy as np
from numpy.typing import NDArray

from ltvn_core.navigation.clearances import MAX_NOISE_POINTS, NARROW_MARGIN_M, Clearances

_DETOUR_RANGES_M = np.array([0.1, 0.2, 0.3, 0.45, 0.6, 0.8])
_DETOUR_BEARINGS_RAD = np.deg2rad(np.arange(-120.0, 121.0, 10.0))
"""Bearings of via points relative to the waypoint's; limited, because the area behind the robot is unseen."""
_GOAL_OFFSETS_M = np.array([0.0, 0.03, -0.03, 0.06, -0.06])
"""Sideways offsets of the end of a path from the waypoint, in metres, because the waypoint is only a prediction."""
_COMFORT_MARGIN_M = 0.06
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
    tight_m = np.maximum(radius_m + _COMFORT_MARGIN_M - np.minimum(first_m, second_m), 0.0)
    cost = np.where(possible, length_m + _CLEARANCE_COST * tight_m, np.inf)
    return places[int(cost.argmin())]


def path_clearance_m(goal: NDArray[np.float64], points: NDArray[np.float64]) -> float:
    """Return the clearance in metres of the straight line to `goal` (2,) from obstacles (M, 2); inf if it is large."""
    return float(Clearances(points).of_lines(np.zeros((1, 2)), goal[None])[0])


def _candidates(goal: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (C, 2) via points and the (C, 2) ends of the ways over them."""
    away_m, bearing = (
        part.ravel() for part in np.meshgrid(_DETOUR_RANGES_M, np.arctan2(goal[1], goal[0]) + _DETOUR_BEARINGS_RAD)
    )
    places = away_m[:, None] * np.stack([np.cos(bearing), np.sin(bearing)], axis=-1)
    onward = goal - places
    aside = (
        np.stack([-onward[:, 1], onward[:, 0]], axis=-1) / np.maximum(np.linalg.norm(onward, axis=-1), 0.01)[:, None]
    )
    ends = goal + _GOAL_OFFSETS_M[:, None, None] * aside
    return np.tile(places, (len(_GOAL_OFFSETS_M), 1)), ends.reshape(-1, 2)
