"""Scripts of worlds by their names, or from a file: doors, light and pictures over time.

Owns the processes of doors (by the hour, at random, for ever) and of light, and the doors that may be closed at the
same time, so that most of a scene stays reachable. Furniture and things are in `moving_script`.
"""

import math
import os
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ltvn_core.errors import WorldError
from ltvn_core.simulation.changes.moving_script import moved_things
from ltvn_core.simulation.changes.world_script import DAY_S, HOUR_S, STATIC, TimedChange, WorldScript, read_script
from ltvn_core.simulation.scene import Scene
from ltvn_core.terminal_text import which_name
from ltvn_core.worlds import DoorMoved, LightChanged, PicturesExchanged

_CONNECTED_SHARE = 0.6
"""Least share of the area of all rooms that stays connected."""
_CLOSED_SHARE = 0.5
"""Greatest share of the doors that is closed at the same time."""
OPENS_S, CLOSES_S = 8 * HOUR_S, 20 * HOUR_S
"""Opening hours of daily doors, in seconds of the day, with a deviation of up to `_UNPUNCTUAL_S`."""
_UNPUNCTUAL_S = 0.4 * HOUR_S
MEAN_OPEN_S, MEAN_CLOSED_S = 1800.0, 600.0
"""Mean times that random doors stay open and closed (a random telegraph signal), in seconds."""
_LIGHT_EVERY_S = HOUR_S / 4
_SUNRISE_H = 6.5
_SUNSET_H = 19.0
_BEDTIME_H = 23.0
_NIGHT = LightChanged(0.3, 0.8)
"""One lamp is left on."""
_EVENING = LightChanged(0.75, 0.7)
"""All lamps are on."""
_EXCHANGE_S = 3 * HOUR_S
WEEK_S = 7 * DAY_S
PEOPLE, CROWD = 3, 6
"""Numbers of people in scripts with people, and with a crowd."""
_Process = Callable[[Scene, np.random.Generator, float], list[TimedChange]]


class OpenRoutes:
    """The rooms of a scene and the doors between them."""

    def __init__(self, scene: Scene) -> None:
        """Read rooms and doors from a scene."""
        self.doors = len(scene.parts.doors)
        """Number of doors."""
        self._areas_m2 = np.array([room.area_m2 for room in scene.rooms])
        self._doors = np.array([door.rooms for door in scene.parts.doors], np.intp).reshape(-1, 2)
        open_always = [door.rooms for door in scene.parts.doorways if door not in scene.parts.doors]
        self._passages = np.array(open_always, np.intp).reshape(-1, 2)

    def remain(self, closed: Collection[int]) -> bool:
        """Return whether enough of the scene stays connected with these doors closed."""
        if len(closed) > _CLOSED_SHARE * self.doors:
            return False
        stays = np.ones(self.doors, bool)
        stays[list(closed)] = False
        first, second = np.concatenate([self._doors[stays], self._passages]).T
        rooms = len(self._areas_m2)
        _, piece = connected_components(coo_array((np.ones(len(first)), (first, second)), (rooms, rooms)))
        return np.bincount(piece, self._areas_m2).max() >= _CONNECTED_SHARE * self._areas_m2.sum()


class _Closing(NamedTuple):
    """A time interval in which a door is to be closed."""

    begin_s: float
    end_s: float
    door: int


def daily_doors(routes: OpenRoutes, rng: np.random.Generator, duration_s: float) -> list[TimedChange]:
    """Return changes of doors that are open from 8:00 to 20:00: as many doors as may be closed at the same time."""
    return _carried_out(routes, _nights(_closable_together(routes, rng), rng, duration_s))


def telegraph_doors(routes: OpenRoutes, rng: np.random.Generator, duration_s: float) -> list[TimedChange]:
    """Return changes of doors that stay open for 30 minutes on average and closed for 10."""
    return _carried_out(routes, _telegraph_closings(range(routes.doors), rng, duration_s))


def mixed_doors(routes: OpenRoutes, rng: np.random.Generator, duration_s: float) -> list[TimedChange]:
    """Return changes of doors: some have opening hours, others are random, and one closes for good after half of the
    time."""
    doors = rng.permutation(routes.doors).tolist()
    closable = [door for door in doors if routes.remain([door])]
    for_good = closable[:1]
    hours = [door for door in doors[: len(doors) // 3] if door not in for_good]
    others = [door for door in doors if door not in hours and door not in for_good]
    closings = [_Closing(duration_s / 2, np.inf, door) for door in for_good]
    closings += _nights(hours, rng, duration_s) + _telegraph_closings(others, rng, duration_s)
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


def _telegraph_closings(doors: Sequence[int], rng: np.random.Generator, duration_s: float) -> list[_Closing]:
    closings: list[_Closing] = []
    for door in doors:
        now_s = rng.exponential(MEAN_OPEN_S)
        while now_s < duration_s:
            end_s = now_s + rng.exponential(MEAN_CLOSED_S)
            closings.append(_Closing(now_s, end_s, door))
            now_s = end_s + rng.exponential(MEAN_OPEN_S)
    return closings


def _carried_out(routes: OpenRoutes, closings: Sequence[_Closing]) -> list[TimedChange]:
    """Return the changes of all closings that leave enough routes; the other closings are dropped."""
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


def daylight(rng: np.random.Generator, duration_s: float) -> list[TimedChange]:
    """Return changes of light every 15 minutes: sun and clouds by day, lamps in the evening, one lamp at night."""
    changes: list[TimedChange] = []
    clouds = 1.0
    for quarter in range(int(duration_s // _LIGHT_EVERY_S) + 1):
        at_s = quarter * _LIGHT_EVERY_S
        clouds = float(np.clip(clouds + rng.normal(0, 0.08), 0.55, 1.0))
        light = _light_at((at_s % DAY_S) / HOUR_S, clouds)
        if not changes or changes[-1].change != light:
            changes.append(TimedChange(at_s, light))
    return changes


def exchanged_pictures(rng: np.random.Generator, duration_s: float) -> list[TimedChange]:
    """Return an exchange of pictures and rugs every night."""
    nights = range(int((duration_s - _EXCHANGE_S) // DAY_S) + 1)
    return [
        TimedChange(night * DAY_S + _EXCHANGE_S, PicturesExchanged(int(rng.integers(1, 2**31)))) for night in nights
    ]


def _light_at(hour: float, clouds: float) -> LightChanged:
    if not _SUNRISE_H <= hour < _BEDTIME_H:
        return _NIGHT
    if hour >= _SUNSET_H:
        return _EVENING
    sun = math.sin(math.pi * (hour - _SUNRISE_H) / (_SUNSET_H - _SUNRISE_H))
    return LightChanged(round(0.45 + 0.6 * math.sqrt(max(sun, 0.0)) * clouds, 3), -0.2)


def _daily(scene: Scene, rng: np.random.Generator, duration_s: float) -> list[TimedChange]:
    return daily_doors(OpenRoutes(scene), rng, duration_s)


def _telegraph(scene: Scene, rng: np.random.Generator, duration_s: float) -> list[TimedChange]:
    return telegraph_doors(OpenRoutes(scene), rng, duration_s)


def _mixed(scene: Scene, rng: np.random.Generator, duration_s: float) -> list[TimedChange]:
    return mixed_doors(OpenRoutes(scene), rng, duration_s)


def _light(scene: Scene, rng: np.random.Generator, duration_s: float) -> list[TimedChange]:
    pictures = scene.parts.paintings or scene.parts.rugs
    return [*daylight(rng, duration_s), *(exchanged_pictures(rng, duration_s) if pictures else ())]


_PROCESSES: dict[str, tuple[_Process, ...]] = {
    "static": (),
    "doors": (_mixed,),
    "daily": (_daily,),
    "telegraph": (_telegraph,),
    "moving": (moved_things,),
    "light": (_light,),
    "people": (),
    "crowd": (),
    "all": (_mixed, moved_things, _light),
}


SCRIPT_NAMES = tuple(_PROCESSES)
"""All names that `make_script` accepts."""


TOGETHER = "+"
"""Joins the names of scripts that run together."""


_NEED_DOORS = ("doors", "daily", "telegraph")


_PEOPLE = {"people": PEOPLE, "crowd": CROWD, "all": PEOPLE}


def make_script(name: str, scene: Scene, *, seed: int = 0, duration_s: float = WEEK_S) -> WorldScript:
    """Return the script with a name, or from a JSON file, for a scene.

    The same name, scene, seed and duration give the same script.

    Args:
        name: One of `SCRIPT_NAMES`, or several that run together (`doors+moving`), or the path of a file, see
            `world_script`.
        scene: Scene of the changes.
        seed: Draws the changes and their times; a file has its own.
        duration_s: Time of the last change, in seconds from midnight of the first day.

    Raises:
        WorldError: There is no such script, its file cannot be read, or its changes are impossible in the scene.
    """
    parts = name.split(TOGETHER)
    if not set(parts) <= _PROCESSES.keys():
        return _from_file(name, scene)
    if name == STATIC.name:
        return STATIC
    if len(parts) > 1:
        _check_together(parts)
    changes = [change for part in parts for change in _changes(part, scene, seed, duration_s)]
    changes.sort(key=lambda timed: timed.at_s)
    return WorldScript(name, seed, tuple(changes), max(_PEOPLE.get(part, 0) for part in parts))


def _changes(name: str, scene: Scene, seed: int, duration_s: float) -> list[TimedChange]:
    """Return the changes of one named script."""
    if name in _NEED_DOORS and not scene.parts.doors:
        raise WorldError(
            f"The scene {scene.name} has no doors, so the script {name!r} would change nothing. Scenes from meshes can "
            "have moving, light and people."
        )
    changes: list[TimedChange] = []
    for number, process in enumerate(_PROCESSES[name]):
        if process is not _mixed or scene.parts.doors:
            changes += process(scene, np.random.default_rng((seed, number)), duration_s)
    return changes


def _check_together(names: Sequence[str]) -> None:
    """Raise WorldError if scripts would change the same things."""
    doors = len(set(names) & set(_NEED_DOORS))
    if doors > 1 or len(set(names)) < len(names) or set(names) & {"all", STATIC.name}:
        raise WorldError(
            f"The world {TOGETHER.join(names)!r} would change the same things twice. Use each name once, at most one "
            f"of {', '.join(_NEED_DOORS)}, and do not combine all or static with others."
        )


def _from_file(name: str, scene: Scene) -> WorldScript:
    path = Path(os.path.expanduser(name))
    if not path.suffix and not path.exists():
        raise WorldError(
            f"There is no world {name!r}. {which_name(name, SCRIPT_NAMES)}; or several of them, as in "
            "doors+moving; or give the path of a JSON file with a script."
        )
    return read_script(path, scene)
