"""One bend: where the straight way to a waypoint is blocked, a place from which the rest is straight. Pure functions.

Owns the search among a few such places, as through a door that lies aslant. What stands around is `nav.obstacle`, and
the moment ahead is `nav.swerve`; nothing here remembers anything.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ltvn_core.nav.swerve import GIVE_M, NOISE_POINTS, ROBOT_RADIUS_M, SQUEEZE_MARGIN_M

_AWAY_M = np.array([0.1, 0.2, 0.3, 0.45, 0.6, 0.8])
_BEARINGS_RAD = np.deg2rad(np.arange(-120.0, 121.0, 10.0))
"""Relative to the waypoint's bearing; what lies behind has not been seen."""
_ASIDE_M = np.array([0.0, 0.03, -0.03, 0.06, -0.06])
"""How far beside the waypoint the way may end, because the waypoint is predicted."""
_SAMPLES = 24
_LEAST_M = ROBOT_RADIUS_M + SQUEEZE_MARGIN_M
_COMFORT_M = ROBOT_RADIUS_M + 0.06
_DISCOMFORT = 20.0
"""What a metre too little of comfort is worth in metres of way."""


def place_to_bend(goal: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Return where (2,) to turn towards a waypoint (2,), None if no single bend leads there.

    All in the robot's frame; `points` (M, 2) are solid.
    """
    if len(points) <= NOISE_POINTS:
        return None
    tree = KDTree(points)
    places, ends = _candidates(goal)
    here = np.zeros_like(places)
    now_m = float(_gaps(tree, here[:1])[0])
    # A robot that is too near already may move away, but not nearer.
    first_m, second_m = _clearance(tree, here, places), _clearance(tree, places, ends)
    possible = (first_m > min(_LEAST_M, now_m - GIVE_M)) & (second_m > _LEAST_M)
    if not possible.any():
        return None
    length_m = np.linalg.norm(places, axis=-1) + np.linalg.norm(ends - places, axis=-1)
    tight_m = np.maximum(_COMFORT_M - np.minimum(first_m, second_m), 0.0)
    cost = np.where(possible, length_m + _DISCOMFORT * tight_m, np.inf)
    return places[int(cost.argmin())]


def clearance(goal: NDArray[np.float64], points: NDArray[np.float64]) -> float:
    """Return the least metres from the straight way to `goal` (2,) to anything solid, `points` (M, 2)."""
    if len(points) <= NOISE_POINTS:
        return float("inf")
    return float(_clearance(KDTree(points), np.zeros((1, 2)), goal[None])[0])


def _candidates(goal: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (C, 2) places to bend at, and (C, 2) where the way ends then."""
    away_m, bearing = (part.ravel() for part in np.meshgrid(_AWAY_M, np.arctan2(goal[1], goal[0]) + _BEARINGS_RAD))
    places = away_m[:, None] * np.stack([np.cos(bearing), np.sin(bearing)], axis=-1)
    onward = goal - places
    aside = (
        np.stack([-onward[:, 1], onward[:, 0]], axis=-1) / np.maximum(np.linalg.norm(onward, axis=-1), 0.01)[:, None]
    )
    ends = goal + _ASIDE_M[:, None, None] * aside
    return np.tile(places, (len(_ASIDE_M), 1)), ends.reshape(-1, 2)


def _clearance(tree: KDTree, starts: NDArray[np.float64], ends: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (C,) the least metres to a solid point on straight ways from (C, 2) to (C, 2), their starts left out."""
    share = np.linspace(0, 1, _SAMPLES + 1)[1:, None, None]
    return _gaps(tree, starts + share * (ends - starts)).min(axis=0)


def _gaps(tree: KDTree, places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (...) metres from places (..., 2) to the nearest believable point."""
    gaps, _ = tree.query(places, k=NOISE_POINTS + 1)
    return np.asarray(gaps)[..., -1]
