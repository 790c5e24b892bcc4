"""Doors over time: by the hour, at random, and for good."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ltvn_core.simulation.changes.open_routes import OpenRoutes
from ltvn_core.simulation.changes.world_script import DAY_S, HOUR_S, TimedChange
from ltvn_core.worlds.world_change import DoorMoved

OPENS_S, CLOSES_S = 8 * HOUR_S, 20 * HOUR_S
"""Doors that keep hours are open between these times of the day, give or take `_UNPUNCTUAL_S`."""
_UNPUNCTUAL_S = 0.4 * HOUR_S
MEAN_OPEN_S, MEAN_CLOSED_S = 1800.0, 600.0
"""How long doors that move at random stay open and closed on average (a random telegraph signal)."""


class _Closing(NamedTuple):
    """A door is to be closed for a while."""

    begin_s: float
    end_s: float
    door: int


def daily_doors(routes: OpenRoutes, rng: np.random.Generator, duration_s: float) -> list[TimedChange]:
    """Return doors that are open from 8 to 20 o'clock: as many as may be closed at once."""
    return _carried_out(routes, _nights(_closable_together(routes, rng), rng, duration_s))


def telegraph_doors(routes: OpenRoutes, rng: np.random.Generator, duration_s: float) -> list[TimedChange]:
    """Return doors that stay open for 30 minutes on average and closed for 10."""
    return _carried_out(routes, _telegraph(range(routes.doors), rng, duration_s))


def mixed_doors(routes: OpenRoutes, rng: np.random.Generator, duration_s: float) -> list[TimedChange]:
    """Return doors of which some keep hours and others move at random, and one is closed for good half way."""
    doors = rng.permutation(routes.doors).tolist()
    closable = [door for door in doors if routes.remain([door])]
    for_good = closable[:1]
    hours = [door for door in doors[: len(doors) // 3] if door not in for_good]
    others = [door for door in doors if door not in hours and door not in for_good]
    closings = [_Closing(duration_s / 2, np.inf, door) for door in for_good]
    closings += _nights(hours, rng, duration_s) + _telegraph(others, rng, duration_s)
    return _carried_out(routes, closings)


def _closable_together(routes: OpenRoutes, rng: np.random.Generator) -> list[int]:
    chosen: list[int] = []
    for door in rng.permutation(routes.doors).tolist():
        if routes.remain([*chosen, door]):
            chosen.append(door)
    return chosen


def _nights(doors: Sequence[int], rng: np.random.Generator, duration_s: float) -> list[_Closing]:
    closings: list[_Closing] = []
    for door in doors:
        closed_s = -np.inf  # The first day begins at midnight, with closed doors.
        for day in range(int(duration_s // DAY_S) + 1):
            opened_s = day * DAY_S + OPENS_S + rng.uniform(-_UNPUNCTUAL_S, _UNPUNCTUAL_S)
            closings.append(_Closing(max(closed_s, 0.0), opened_s, door))
            closed_s = day * DAY_S + CLOSES_S + rng.uniform(-_UNPUNCTUAL_S, _UNPUNCTUAL_S)
        closings.append(_Closing(closed_s, np.inf, door))
    return closings


def _telegraph(doors: Sequence[int], rng: np.random.Generator, duration_s: float) -> list[_Closing]:
    closings: list[_Closing] = []
    for door in doors:
        now_s = rng.exponential(MEAN_OPEN_S)
        while now_s < duration_s:
            end_s = now_s + rng.exponential(MEAN_CLOSED_S)
            closings.append(_Closing(now_s, end_s, door))
            now_s = end_s + rng.exponential(MEAN_OPEN_S)
    return closings


def _carried_out(routes: OpenRoutes, closings: Sequence[_Closing]) -> list[TimedChange]:
    """Return the changes of those closings that leave enough routes; the others do not happen."""
    changes: list[TimedChange] = []
    closed_until: dict[int, float] = {}
    for begin_s, end_s, door in sorted(closings):
        closed_until = {each: until for each, until in closed_until.items() if until > begin_s}
        if door in closed_until or not routes.remain([*closed_until, door]):
            continue
        closed_until[door] = end_s
        changes.append(TimedChange(begin_s, DoorMoved(door, is_open=False)))
        if np.isfinite(end_s):
            changes.append(TimedChange(end_s, DoorMoved(door, is_open=True)))
    return changes
