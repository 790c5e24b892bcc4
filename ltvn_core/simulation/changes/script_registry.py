"""Scripts of worlds by their names, or from a file. What each brings is in a module of its own."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from ltvn_core.close_names import which_name
from ltvn_core.errors import WorldError
from ltvn_core.simulation.changes.door_scripts import daily_doors, mixed_doors, telegraph_doors
from ltvn_core.simulation.changes.light_script import daylight, exchanged_pictures
from ltvn_core.simulation.changes.moving_script import moved_things
from ltvn_core.simulation.changes.open_routes import OpenRoutes
from ltvn_core.simulation.changes.script_file import read_script
from ltvn_core.simulation.changes.world_script import DAY_S, STATIC, TimedChange, WorldScript
from ltvn_core.simulation.scene import Scene

WEEK_S = 7 * DAY_S
PEOPLE, CROWD = 3, 6
"""So many people walk about where a script has people, and where it has many."""

_Process = Callable[[Scene, np.random.Generator, float], list[TimedChange]]


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
"""All names that `make_script` knows."""
TOGETHER = "+"
"""Joins the names of scripts that run together."""
_NEED_DOORS = ("doors", "daily", "telegraph")
_PEOPLE = {"people": PEOPLE, "crowd": CROWD, "all": PEOPLE}


def make_script(name: str, scene: Scene, *, seed: int = 0, duration_s: float = WEEK_S) -> WorldScript:
    """Return the script of a name, or the one in a JSON file, for a scene.

    The same name, scene, seed and duration give the same script.

    Args:
        name: One of `SCRIPT_NAMES`, or several that run together (`doors+moving`), or the path of a file, see
            `script_file`.
        scene: Where it happens.
        seed: Draws what happens and when; a file has its own.
        duration_s: Seconds from midnight of the first day until which something happens.

    Raises:
        WorldError: There is no such script, its file cannot be read, or the scene cannot carry it out.
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
    """Return what one named script brings."""
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
            f"The world {TOGETHER.join(names)!r} would change the same things twice. Join each name once, at most one "
            f"of {', '.join(_NEED_DOORS)}, and neither all nor static."
        )


def _from_file(name: str, scene: Scene) -> WorldScript:
    path = Path(name).expanduser()
    if not path.suffix and not path.exists():
        raise WorldError(
            f"There is no world {name!r}. {which_name(name, SCRIPT_NAMES)}; or several of them, as in "
            "doors+moving; or give the path of a JSON file with a script."
        )
    return read_script(path, scene)
