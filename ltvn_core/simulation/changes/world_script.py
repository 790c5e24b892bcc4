"""What happens in a world over time: changes and their moments, as JSON files too. Carries nothing out.

People may write such a file by hand; it is checked in full when it is read:

    {"name": "evening", "seed": 0, "people": 0, "changes": [
        {"at_s": 68400, "change": "DoorMoved", "door": 2, "is_open": false},
        {"at_s": 68700, "change": "ThingPlaced", "thing": "parcel", "kind": "box",
         "pose": [1.5, 2.0, 0.3], "size": [0.4, 0.3, 0.5]}]}

Each change has its moment, in seconds from midnight of the first day, its class name of `worlds.world_change`, and the
fields of that class.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import cattrs
from cattrs.strategies import configure_tagged_union

from ltvn_core.atomic_files import atomic_output
from ltvn_core.errors import WorldError
from ltvn_core.simulation.changes.world_check import check_change
from ltvn_core.simulation.scene import Scene
from ltvn_core.structured_text import parse_json
from ltvn_core.worlds.world_change import ThingKind, WorldChange
from ltvn_core.worlds.world_state import AS_MADE

HOUR_S = 3600.0
DAY_S = 24 * HOUR_S
MORNING_S = 9 * HOUR_S
"""A world begins at nine o'clock of its first day."""
_TAG = "change"
_LARGEST_BYTES = 64_000_000
_MOST_PEOPLE = 20


@dataclass(frozen=True, slots=True)
class TimedChange:
    """A change and when it happens."""

    at_s: float
    """Seconds from midnight of the first day."""
    change: WorldChange


@dataclass(frozen=True, slots=True)
class WorldScript:
    """The changes of a world over time."""

    name: str
    seed: int = 0
    changes: tuple[TimedChange, ...] = ()
    """In the order of their times."""
    people: int = 0
    """So many people walk about by day."""

    @property
    def is_static(self) -> bool:
        """Whether nothing ever changes by itself."""
        return not self.changes and not self.people


STATIC = WorldScript("static")
"""Nothing ever changes by itself."""


def read_script(path: Path, scene: Scene) -> WorldScript:
    """Read a script for a scene.

    Raises:
        WorldError: The file is missing, no script, or has a change that the scene cannot carry out; says which one.
    """
    try:
        if path.stat().st_size > _LARGEST_BYTES:
            raise WorldError(f"The script {path} is larger than {_LARGEST_BYTES // 1_000_000} MB; no script is.")
        data = parse_json(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise WorldError(f"The script {path} cannot be read as JSON: {error}.") from error
    if not isinstance(data, dict) or not isinstance(data.get("changes"), list):
        raise WorldError(f'The script {path} is no object with a list "changes".')
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
    """Write a script, whole or not at all."""
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
        raise WorldError(f"{where[0].upper()}{where[1:]} is no {row[_TAG]}: {error}.") from error
    if not 0 <= at_s < float("inf"):
        raise WorldError(f"{where[0].upper()}{where[1:]} happens at {at_s} s; a moment is 0 s or later.")
    return TimedChange(at_s, change)


def _whole(value: object, what: str, most: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= most:
        raise WorldError(f"The {what} is a whole number from 0 to {most}, got {value!r}.")
    return value


def _check(script: WorldScript, scene: Scene, path: Path) -> None:
    """Raise WorldError for the first change that the scene cannot carry out."""
    state = AS_MADE
    for timed in script.changes:
        try:
            check_change(timed.change, scene, state)
        except WorldError as error:
            raise WorldError(f"The script {path} cannot happen at {timed.at_s:g} s: {error}") from error
        state = state.after(timed.change)
