"""What changes a world accepts: those that its scene can carry out. Changes come from people, pages and files."""

import math
from typing import assert_never

from ltvn_core.errors import WorldError
from ltvn_core.simulation.scene import Scene
from ltvn_core.worlds import world_change as w
from ltvn_core.worlds.world_state import WorldState

SIZE_LIMITS_M = (0.05, 3.0)
"""Each side of a thing lies between these."""
LEVEL_LIMITS = (0.05, 2.0)
"""Brightness lies between these."""
_LONGEST_NAME = 64
_LONGEST_PASSING_S = 366 * 86_400.0


def check_change(change: w.WorldChange, scene: Scene, state: WorldState) -> None:
    """Raise WorldError for a change that cannot be in a scene, as it was made, whose world is in a state."""
    match change:
        case w.DoorMoved(door):
            doors = len(scene.parts.doors)
            if not 0 <= door < doors:
                valid = f"Doors have numbers from 0 to {doors - 1}." if doors else "Scenes from meshes have no doors."
                raise WorldError(f"The scene {scene.name} has no door {door}. {valid}")
        case w.ThingPlaced():
            _check_placed(change, scene)
        case w.ThingRemoved(thing):
            _check_removed(thing, scene, state)
        case w.ThingReturned(thing):
            _require_own(thing, scene)
        case w.LightChanged(level, warmth):
            _require_between(level, LEVEL_LIMITS, "brightness")
            _require_between(warmth, (-1.0, 1.0), "warmth")
        case w.PicturesExchanged(seed):
            if seed is not None and seed < 0:
                raise WorldError(f"Pictures are drawn with a seed of 0 or more, got {seed}.")
        case w.PersonMoved(person, pose, seed):
            _require_name(person)
            _require_pose(pose, person)
            if seed < 0:
                raise WorldError(f"The clothes of {person} are drawn with a seed of 0 or more, got {seed}.")
        case w.PersonLeft(person):
            if person not in {each.person for each in state.people}:
                raise WorldError(f"{person!r} cannot leave: nobody of that name is there.")
        case w.TimePassed(duration_s):
            _require_between(duration_s, (0.0, _LONGEST_PASSING_S), "time that passes, in seconds,")
        case _:
            assert_never(change)


def _check_placed(placed: w.ThingPlaced, scene: Scene) -> None:
    _require_name(placed.thing)
    _require_pose(placed.pose, placed.thing)
    for side in placed.size:
        _require_between(side, SIZE_LIMITS_M, f"size of {placed.thing} in metres")
    if placed.kind is w.ThingKind.FURNITURE:
        _require_own(placed.thing, scene)
    elif placed.thing.startswith(w.OWN_PREFIX):
        raise WorldError(
            f"{placed.thing!r} is the name of a scene's own furniture; give a {placed.kind} a name without "
            f"{w.OWN_PREFIX!r} in front."
        )


def check_floor(placed: w.ThingPlaced, scene: Scene) -> None:
    """Raise WorldError where a thing would stand in a wall or in something else in a scene as it is without it."""
    x, y, _ = placed.pose
    if not _is_on_floor(scene, x, y):
        raise WorldError(
            f"{placed.thing} cannot stand at x {x:.2f} m, y {y:.2f} m: there is a wall or something else, or no "
            "floor. Choose a free place."
        )


def _check_removed(thing: str, scene: Scene, state: WorldState) -> None:
    if state.thing(thing) is not None:
        return
    if not thing.startswith(w.OWN_PREFIX):
        names = ", ".join(each.thing for each in state.things) or "none"
        raise WorldError(f"{thing!r} cannot be taken away: nothing of that name stands there. Things: {names}.")
    _require_own(thing, scene)
    if thing in state.missing:
        raise WorldError(f"{thing!r} cannot be taken away: it is away already.")


def _require_own(thing: str, scene: Scene) -> None:
    names = [w.OWN_PREFIX + piece.name for piece in scene.parts.furniture]
    if thing not in names:
        some = f"It has {', '.join(names[:5])}, ..." if names else "A scene from a mesh has none that can be moved."
        raise WorldError(f"The scene {scene.name} has no furniture {thing!r}. {some}")


def _require_name(name: str) -> None:
    if not 0 < len(name) <= _LONGEST_NAME or not name.isprintable():
        raise WorldError(f"A name has 1 to {_LONGEST_NAME} printable characters, got {name[: 2 * _LONGEST_NAME]!r}.")


def _require_pose(pose: w.PlaceRow, name: str) -> None:
    if len(pose) != 3 or not all(math.isfinite(value) for value in pose):
        raise WorldError(f"{name} stands at x and y in metres and yaw in radians, got {pose}.")


def _require_between(value: float, limits: tuple[float, float], what: str) -> None:
    if not limits[0] <= value <= limits[1]:
        raise WorldError(f"The {what} lies between {limits[0]:g} and {limits[1]:g}, got {value:g}.")


def _is_on_floor(scene: Scene, x: float, y: float) -> bool:
    clearance = scene.clearance
    column, row = (math.floor(v) for v in ((x, y) - clearance.origin) / clearance.resolution_m)
    rows, columns = clearance.blocked.shape
    return 0 <= row < rows and 0 <= column < columns and not clearance.blocked[row, column]
