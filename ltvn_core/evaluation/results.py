"""The results of evaluations as plain data: maps, trials, and tests with maintenance.

Field names are the keys of the JSON files, so they stay. `query_result` has the rows; `metrics`, `lifelong_metrics` and
`world_metrics` compute the metrics over results.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cattrs

from ltvn_core.atomic_files import write_text_atomically
from ltvn_core.errors import OptionError
from ltvn_core.evaluation.gzipped_results import read_result_text
from ltvn_core.evaluation.query_result import CONVERTER, QueryResult
from ltvn_core.structured_text import parse_json


@dataclass(frozen=True, slots=True)
class MapTruthMetrics:
    """The size of a map and its errors by the ground truth."""

    nodes: int
    edges: int
    """Directed ones."""
    spurious_edges: int
    """Directed edges that are spurious."""
    pieces: int
    """Number of strongly connected components; 1 is ideal."""
    goals_connected: int
    """Goals that can be reached from most of the map."""
    goals_told: int | None = None
    """Goals of which the map says before any drive that it does not hold them surely; None in older results,"""
    goals_told_rightly: int | None = None
    """and those of them to which no drivable way leads from most of the map."""
    goals_untold: int | None = None
    """Goals that have no such way either, and the map claims to hold them."""


@dataclass(frozen=True, slots=True)
class MapDrawing:
    """A map over the floor plan of its scene, for drawing."""

    origin: tuple[float, float]
    """x and y of the corner of the first cell, metres."""
    resolution_m: float
    free: tuple[str, ...]
    """Rows from low y to high y, one character per cell: "." is navigable, "#" is not."""
    nodes: tuple[tuple[int, float, float, float], ...]
    """Node, exact x, y and yaw."""
    edges: tuple[tuple[int, int, float, bool], ...]
    """Source, target, p, and whether it is spurious."""


@dataclass(frozen=True, slots=True)
class TrialResult:
    """All episodes of one method in one scene with one map seed."""

    scene: str
    method: str
    """ltvn, sptm or ving."""
    preset: str
    """robust or paper; of the navigator."""
    without: tuple[str, ...]
    """Parts of the method that were switched off."""
    finetuned: bool
    seed: int
    queries: int
    """Queries with maintenance before these episodes; 0 is the map as it was built."""
    images: int
    """Of the mapping drive."""
    fingerprint: str
    """Of the weights in use."""
    map: MapTruthMetrics
    floorplan: MapDrawing | None
    """None in a file: the drawing lies beside it, see `evaluation.map_drawings`. Older files hold it themselves."""
    episodes: tuple[QueryResult, ...]
    wall_s: float
    """Time that the episodes took, over all processes."""
    version: str
    command: str
    """Command that reproduces this result."""
    without_depth: int = 0
    """Images of the mapping drive that have no depth."""
    perturbations: tuple[str, ...] = ()
    """What was wrong with the robot's camera in the episodes."""
    conditions: tuple[str, ...] = ()
    """What was harder than usual, see `evaluation.conditions`."""


@dataclass(frozen=True, slots=True)
class EdgeCalibrationBin:
    """Edges whose p is in one bin, and how many of them are drivable."""

    low: float
    high: float
    edges: int
    mean_p: float
    drivable: float


@dataclass(frozen=True, slots=True)
class LifelongPoint:
    """The map after some queries with maintenance."""

    queries: int
    trial: TrialResult
    """The static episodes again, with maintenance off."""
    calibration: tuple[EdgeCalibrationBin, ...]
    """Calibration of p."""


@dataclass(frozen=True, slots=True)
class LifelongResult:
    """Queries with maintenance in one scene with one map seed, and the tests in between."""

    scene: str
    preset: str
    without: tuple[str, ...]
    seed: int
    points: tuple[LifelongPoint, ...]
    """At 0, 100, 200, ... queries."""
    queries: tuple[QueryResult, ...]
    version: str
    command: str
    maintenance: str | None = None
    """None is what the system does."""


@dataclass(frozen=True, slots=True)
class EvaluationResults:
    """All results in one folder."""

    trials: tuple[TrialResult, ...] = ()
    lifelong: tuple[LifelongResult, ...] = ()


@dataclass(frozen=True, slots=True)
class DoorMove:
    """A door was closed or opened by the script."""

    at_s: float
    door: int
    is_open: bool


@dataclass(frozen=True, slots=True)
class WorldResult:
    """All queries of one maintenance in one changing scene with one map seed."""

    scene: str
    preset: str
    without: tuple[str, ...]
    seed: int
    world: str
    days: float
    maintenance: str
    nodes: int
    """Of the map before the first query."""
    edges: int
    """Of the map before the first query."""
    true_edges: int
    """Edges of that map that are not spurious."""
    doors: tuple[DoorMove, ...]
    queries: tuple[QueryResult, ...]
    wall_s: float
    version: str
    command: str


def save_results(path: Path, results: Any) -> None:
    """Write one of these dataclasses as JSON to a new file, whole or not at all. Raises RecordingError."""
    write_text_atomically(path, json.dumps(CONVERTER.unstructure(results), separators=(",", ":")))


def load_results(path: Path, kind: type) -> Any:
    """Read results of a kind that `save_results` wrote, gzipped or not. Raises OptionError for any other file."""
    try:
        return CONVERTER.structure(parse_json(read_result_text(path)), kind)
    except OSError as error:
        raise OptionError(f"{path} cannot be read: {error.strerror}.") from error
    except (ValueError, TypeError, AttributeError, cattrs.BaseValidationError) as error:
        raise OptionError(f"{path} holds no {kind.__name__} of this version: {error}.") from error
