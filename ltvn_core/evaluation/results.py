"""What evaluation finds, as plain data: episodes, maps, trials, and queries with maintenance.

Owns the shape of these results and their JSON. Computes nothing: figures over them are in `evaluate.metrics`.
"""

import json
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

import cattrs

from ltvn_core.errors import OptionError
from ltvn_core.recording.atomic_files import write_text_atomically
from ltvn_core.types import FrameId


class FailureCause(StrEnum):
    """The one cause that an episode's failure is put down to, by the simulator's truth."""

    WRONG_ARRIVAL = "wrong arrival"
    """The robot said that it had arrived, and had not."""
    SPURIOUS_EDGE = "spurious edge"
    """It spent its time on edges that nobody can drive."""
    MISLOCALISED = "mis-localised"
    """It held itself to be somewhere else."""
    COLLISION = "collision"
    """The controller touched things too often, or was blocked."""
    NO_PATH = "no path"
    """The map has no way to the goal."""
    STEP_LIMIT = "step limit"
    """It was just too slow."""


@dataclass(frozen=True, slots=True)
class EpisodeResult:
    """One episode and its verdict."""

    episode: int
    start: FrameId
    """The image of the mapping drive at whose exact pose the robot was put down."""
    goal: FrameId
    """The goal image."""
    reached: bool
    """Within 0.72 m and 0.4 rad by the robot's own decision (paper)."""
    outcome: str
    """How the robot says it ended, see `nav.events.Outcome`."""
    failure: FailureCause | None
    """None where the goal was reached."""
    trigger: FailureCause | None
    """What went wrong first since all was last well; may differ from what cost most."""
    steps: int
    collisions: int
    path_m: float
    """Driven length."""
    shortest_m: float
    """Length of the shortest feasible path from start to goal."""
    position_error_m: float
    yaw_error_rad: float

    @property
    def spl(self) -> float:
        """Success weighted by path length (Anderson et al. 2018), in [0, 1]."""
        return self.shortest_m / max(self.path_m, self.shortest_m, 1e-9) if self.reached else 0.0


@dataclass(frozen=True, slots=True)
class MapTruthMetrics:
    """A map against the simulator's truth."""

    nodes: int
    edges: int
    """Directed ones."""
    spurious_edges: int
    """Directed edges that nobody can drive."""
    pieces: int
    """Parts between which no path leads there and back; 1 is what one wants."""
    goals_connected: int
    """Goals that can be reached from most of the map."""


@dataclass(frozen=True, slots=True)
class MapDrawing:
    """What a figure of the map over the scene needs."""

    origin: tuple[float, float]
    """x and y of the corner of the first cell, metres."""
    resolution_m: float
    free: tuple[str, ...]
    """Rows from low y to high y, a character a cell: "." where a robot fits, "#" where not."""
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
    """What makes this result again."""


@dataclass(frozen=True, slots=True)
class EdgeCalibrationBin:
    """Edges whose p lies in one bin, and how many of them can truly be driven."""

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
    """One query with maintenance and what it did to the map."""

    query: int
    reached: bool
    outcome: str
    steps: int
    collisions: int
    pruned: int
    """Edges that left the map,"""
    pruned_bad: int
    """and how many of them nobody can drive or the robot could not drive."""
    added_nodes: int
    added_edges: int
    added_spurious: int
    """Of the added edges, those that nobody can drive."""
    nodes: int
    """In the map afterwards."""
    edges: int
    spurious_edges: int
    pruned_spurious: int = 0
    """Of the pruned edges, those that nobody can drive."""


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


@dataclass(frozen=True, slots=True)
class EvaluationResults:
    """What one folder of results holds."""

    trials: tuple[TrialResult, ...] = ()
    lifelong: tuple[LifelongResult, ...] = ()


_CONVERTER = cattrs.Converter(forbid_extra_keys=True)


def save_results(path: Path, results: Any) -> None:
    """Write one of these dataclasses as JSON to a new file, whole or not at all. Raises RecordingError."""
    write_text_atomically(path, json.dumps(asdict(results), separators=(",", ":")))


def load_results(path: Path, kind: type) -> Any:
    """Read what `save_results` wrote of that kind. Raises OptionError for a file that is none."""
    try:
        return _CONVERTER.structure(json.loads(path.read_text(encoding="utf-8")), kind)
    except OSError as error:
        raise OptionError(f"{path} cannot be read: {error.strerror}.") from error
    except (ValueError, TypeError, AttributeError, cattrs.BaseValidationError) as error:
        raise OptionError(f"{path} holds no {kind.__name__} of this version: {error}.") from error
