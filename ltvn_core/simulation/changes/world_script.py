"""Scripts of a world: changes and their times, also as JSON files. Applies nothing.

People may write such a file by hand; it is checked in full when it is read:

    {"name": "evening", "seed": 0, "people": 0, "changes": [
        {"at_s": 68400, "change": "DoorMoved", "door": 2, "is_open": false},
        {"at_s": 68700, "change": "ThingPlaced", "thing": "parcel", "kind": "box",
         "pose": [1.5, 2.0, 0.3], "size": [0.4, 0.3, 0.5]}]}

Each change has its time, in seconds from midnight of the first day, the name of its class in `ltvn_core.worlds`, and
the fields of that class. A world accepts the changes that are possible in its scene, from people, pages and files.
"""

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, assert_never, get_args

import cattrs
from cattrs.strategies import configure_tagged_union

from ltvn_core import worlds as w
from ltvn_core.atomic_files import atomic_output
from ltvn_core.errors import WorldError
from ltvn_core.simulation.scene import Scene
from ltvn_core.structured_text import parse_json
from ltvn_core.worlds import AS_MADE, ThingKind, WorldChange, WorldState

SIZE_LIMITS_M = (0.05, 3.0)
"""Limits of each side of a thing, in metres."""
LEVEL_LIMITS = (0.05, 2.0)
"""Limits of brightness."""
_LONGEST_NAME = 64
_LONGEST_PASSING_S = 366 * 86_400.0


def check_change(change: w.WorldChange, scene: Scene, state: WorldState) -> None:
    """Raise WorldError for a change that is impossible in an unchanged scene and a state of its world."""
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
                raise WorldError(f"The seed of pictures must be 0 or more, got {seed}.")
        case w.PersonMoved(person, pose, seed):
            _require_name(person)
            _require_pose(pose, person)
            if seed < 0:
                raise WorldError(f"The seed of the clothes of {person} must be 0 or more, got {seed}.")
        case w.PersonLeft(person):
            if person not in {each.person for each in state.people}:
                raise WorldError(f"{person!r} cannot leave: there is no person of that name.")
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
    """Raise WorldError if a thing would overlap with a wall or another object of the scene."""
    x, y, _ = placed.pose
    if not _is_on_floor(scene, x, y):
        raise WorldError(
            f"{placed.thing} cannot stand at x {x:.2f} m, y {y:.2f} m: the place is occupied, or has no floor. Choose "
            "a free place."
        )


def _check_removed(thing: str, scene: Scene, state: WorldState) -> None:
    if state.thing(thing) is not None:
        return
    if not thing.startswith(w.OWN_PREFIX):
        names = ", ".join(each.thing for each in state.things) or "none"
        raise WorldError(f"{thing!r} cannot be removed: there is nothing of that name. Things: {names}.")
    _require_own(thing, scene)
    if thing in state.missing:
        raise WorldError(f"{thing!r} cannot be removed: it is already removed.")


def _require_own(thing: str, scene: Scene) -> None:
    names = [w.OWN_PREFIX + piece.name for piece in scene.parts.furniture]
    if thing not in names:
        some = f"It has {', '.join(names[:5])}, ..." if names else "The furniture of a mesh scene cannot be moved."
        raise WorldError(f"The scene {scene.name} has no furniture {thing!r}. {some}")


def _require_name(name: str) -> None:
    if not 0 < len(name) <= _LONGEST_NAME or not name.isprintable():
        raise WorldError(
            f"A name must have 1 to {_LONGEST_NAME} printable characters, got {name[: 2 * _LONGEST_NAME]!r}."
        )


def _require_pose(pose: w.PlaceRow, name: str) -> None:
    if len(pose) != 3 or not all(math.isfinite(value) for value in pose):
        raise WorldError(f"{name} needs x and y in metres and yaw in radians, got {pose}.")


def _require_between(value: float, limits: tuple[float, float], what: str) -> None:
    if not limits[0] <= value <= limits[1]:
        raise WorldError(f"The {what} must be between {limits[0]:g} and {limits[1]:g}, got {value:g}.")


def _is_on_floor(scene: Scene, x: float, y: float) -> bool:
    clearance = scene.clearance
    column, row = (math.floor(v) for v in ((x, y) - clearance.origin) / clearance.resolution_m)
    rows, columns = clearance.blocked.shape
    return 0 <= row < rows and 0 <= column < columns and not clearance.blocked[row, column]


HOUR_S = 3600.0
DAY_S = 24 * HOUR_S
MORNING_S = 9 * HOUR_S
"""Start of a world, in seconds: nine o'clock of its first day."""
_TAG = "change"
_LARGEST_BYTES = 64_000_000
_MOST_PEOPLE = 20


@dataclass(frozen=True, slots=True)
class TimedChange:
    """A change and its time."""

    at_s: float
    """Time in seconds from midnight of the first day."""
    change: WorldChange


@dataclass(frozen=True, slots=True)
class WorldScript:
    """The changes of a world over time."""

    name: str
    seed: int = 0
    changes: tuple[TimedChange, ...] = ()
    """Changes in the order of their times."""
    people: int = 0
    """Number of people who walk about by day."""

    @property
    def is_static(self) -> bool:
        """Whether the script has no changes."""
        return not self.changes and not self.people


STATIC = WorldScript("static")
"""A script without changes."""


def read_script(path: Path, scene: Scene) -> WorldScript:
    """Read a script for a scene.

    Raises:
        WorldError: The file is missing, is not a script, or has a change that is impossible in the scene.
    """
    try:
        if path.stat().st_size > _LARGEST_BYTES:
            raise WorldError(
                f"The script {path} is larger than {_LARGEST_BYTES // 1_000_000} MB, the largest size of a script."
            )
        data = parse_json(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise WorldError(f"The script {path} cannot be read as JSON: {error}.") from error
    if not isinstance(data, dict) or not isinstance(data.get("changes"), list):
        raise WorldError(f'The script {path} is not an object with a list "changes".')
    unknown = data.keys() - {"name", "seed", "people", "changes"}
    if unknown:
        raise WorldError(f"The script {path} has unknown keys: {', '.join(sorted(unknown))}.")
    changes = tuple(_timed(row, f"change {number} of {path}") for number, row in enumerate(data["changes"], 1))
    script = WorldScript(
        name=str(data.get("name", path.stem)),
        seed=_whole(data.get("seed", 0), f"seed of {path}", 2**63),
        changes=tuple(sorted(changes, key=lambda timed: timed.at_s)),
        people=_whole(data.get("people", 0), f"number of people of {path}", _MOST_PEOPLE),
    )
    _check(script, scene, path)
    return script


def write_script(script: WorldScript, path: Path) -> None:
    """Write a script atomically."""
    rows = [
        {"at_s": timed.at_s, **_CONVERTER.unstructure(timed.change, unstructure_as=WorldChange)}
        for timed in script.changes
    ]
    data = {"name": script.name, "seed": script.seed, "people": script.people, "changes": rows}
    with atomic_output(path) as part:
        part.write_text(json.dumps(data, allow_nan=False, indent=1), encoding="utf-8")


def _converter() -> cattrs.Converter:
    converter = cattrs.Converter(forbid_extra_keys=True, detailed_validation=False)
    for exact in (bool, int, str):
        converter.register_structure_hook(exact, _only(exact))
    converter.register_structure_hook(float, _number)
    converter.register_structure_hook(ThingKind, lambda value, _: ThingKind(value))
    configure_tagged_union(WorldChange, converter, tag_name=_TAG)
    return converter


def _only(kind: type) -> Any:
    def exact(value: object, _: object) -> object:
        if type(value) is not kind:
            raise ValueError(f"expected {kind.__name__}, got {value!r}")
        return value

    return exact


def _number(value: object, _: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"expected a number, got {value!r}")
    return float(value)


_CONVERTER = _converter()


def _timed(row: object, where: str) -> TimedChange:
    """Read one change. Raises WorldError."""
    kinds = [kind.__name__ for kind in get_args(WorldChange)]
    if not isinstance(row, dict) or row.get(_TAG) not in kinds:
        raise WorldError(f'{where[0].upper()}{where[1:]} has no "{_TAG}" that is one of {", ".join(kinds)}.')
    fields = {key: value for key, value in row.items() if key != "at_s"}
    try:
        at_s = _number(row.get("at_s"), float)
        change = _CONVERTER.structure(fields, WorldChange)  # pyright: ignore[reportArgumentType]
    except (ValueError, KeyError, TypeError, cattrs.BaseValidationError, cattrs.ForbiddenExtraKeysError) as error:
        raise WorldError(f"{where[0].upper()}{where[1:]} is not a valid {row[_TAG]}: {error}.") from error
    if not 0 <= at_s < float("inf"):
        raise WorldError(f"{where[0].upper()}{where[1:]} happens at {at_s} s; a time must be 0 s or later.")
    return TimedChange(at_s, change)


def _whole(value: object, what: str, most: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= most:
        raise WorldError(f"The {what} must be a whole number from 0 to {most}, got {value!r}.")
    return value


def _check(script: WorldScript, scene: Scene, path: Path) -> None:
    """Raise WorldError for the first change that is impossible in the scene."""
    state = AS_MADE
    for timed in script.changes:
        try:
            check_change(timed.change, scene, state)
        except WorldError as error:
            raise WorldError(f"The script {path} has an impossible change at {timed.at_s:g} s: {error}") from error
        state = state.after(timed.change)
