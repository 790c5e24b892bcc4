"""The results of evaluations as plain data: episodes, maps, trials, and queries with maintenance.

Field names are the keys of the JSON files, so they stay. `metrics` computes the metrics over results.
"""

import json
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

import cattrs

from ltvn_core.atomic_files import write_text_atomically
from ltvn_core.errors import OptionError
from ltvn_core.evaluation.gzipped_results import read_result_text
from ltvn_core.structured_text import parse_json
from ltvn_core.types import FrameId


class FailureCause(StrEnum):
    """The cause to which the failure of an episode is attributed, by the ground truth."""

    WRONG_ARRIVAL = "wrong arrival"
    """The robot decided that it had arrived, and had not."""
    SPURIOUS_EDGE = "spurious edge"
    """It spent its time on spurious edges."""
    MISLOCALISED = "mis-localised"
    """It localised at a node where it was not."""
    COLLISION = "collision"
    """The controller collided too often, or was blocked."""
    NO_PATH = "no path"
    """The map has no path to the goal."""
    STEP_LIMIT = "step limit"
    """It reached the step limit without another cause."""


@dataclass(frozen=True, slots=True)
class EpisodeResult:
    """The result of one episode."""

    episode: int
    start: FrameId
    """Image of the mapping drive at whose exact pose the robot started."""
    goal: FrameId
    """The goal image."""
    reached: bool
    """Within 0.72 m and 0.4 rad by the robot's own decision (paper)."""
    outcome: str
    """Outcome by the robot's own decision, see `navigation.events.Outcome`."""
    failure: FailureCause | None
    """None where the goal was reached."""
    trigger: FailureCause | None
    """The first cause since the last correct localisation; may differ from the one with most steps."""
    steps: int
    collisions: int
    path_m: float
    """Driven length."""
    shortest_m: float
    """Length of the shortest feasible path from start to goal."""
    position_error_m: float
    yaw_error_rad: float
    checkpoints: int | None = None
    """Checkpoints on the way from start to goal, see `evaluation.checkpoints`; None in older results, as all below."""
    crossed: int | None = None
    """How many of them the robot crossed."""
    localised: int | None = None
    """Localisations that found a node."""
    mislocalised: int | None = None
    """Those of them at a node where the robot was not, most often one that looks alike."""

    @property
    def spl(self) -> float:
        """Success weighted by path length (Anderson et al. 2018), in [0, 1]."""
        return self.shortest_m / max(self.path_m, self.shortest_m, 1e-9) if self.reached else 0.0


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
    episodes: tuple[EpisodeResult, ...]
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
class LifelongQuery:
    """One query with maintenance and its changes of the map."""

    query: int
    reached: bool
    outcome: str
    steps: int
    collisions: int
    pruned: int
    """Edges that were pruned,"""
    pruned_bad: int
    """and how many of them are spurious or could not be driven by the robot."""
    added_nodes: int
    added_edges: int
    added_spurious: int
    """Added edges that are spurious."""
    nodes: int
    """In the map afterwards."""
    edges: int
    spurious_edges: int
    pruned_spurious: int = 0
    """Pruned edges that are spurious."""


@dataclass(frozen=True, slots=True)
class LifelongResult:
    """Queries with maintenance in one scene with one map seed, and the tests in between."""

    scene: str
    preset: str
    without: tuple[str, ...]
    seed: int
    points: tuple[LifelongPoint, ...]
    """At 0, 100, 200, ... queries."""
    queries: tuple[LifelongQuery, ...]
    version: str
    command: str
    maintenance: str | None = None
    """None is what the system does."""


@dataclass(frozen=True, slots=True)
class EvaluationResults:
    """All results in one folder."""

    trials: tuple[TrialResult, ...] = ()
    lifelong: tuple[LifelongResult, ...] = ()


_CONVERTER = cattrs.Converter(forbid_extra_keys=True)


def save_results(path: Path, results: Any) -> None:
    """Write one of these dataclasses as JSON to a new file, whole or not at all. Raises RecordingError."""
    write_text_atomically(path, json.dumps(asdict(results), separators=(",", ":")))


def load_results(path: Path, kind: type) -> Any:
    """Read results of a kind that `save_results` wrote, gzipped or not. Raises OptionError for any other file."""
    try:
        return _CONVERTER.structure(parse_json(read_result_text(path)), kind)
    except OSError as error:
        raise OptionError(f"{path} cannot be read: {error.strerror}.") from error
    except (ValueError, TypeError, AttributeError, cattrs.BaseValidationError) as error:
        raise OptionError(f"{path} holds no {kind.__name__} of this version: {error}.") from error
