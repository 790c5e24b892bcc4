"""Results of evaluations as plain data (maps, trials, and tests with maintenance), and their files.

Field names are the keys of the JSON files, so they must not change. A file may be gzipped: `NAME.json.gz` replaces
`NAME.json` wherever results are read, and its bytes do not depend on the time of packing. The drawing of a map is a
separate file beside the results. `query_result` has the rows; `metrics` and `world_metrics` compute the metrics.
"""

import gzip
import json
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import cattrs
import numpy as np

from ltvn_core.atomic_files import atomic_output, write_text_atomically
from ltvn_core.errors import OptionError
from ltvn_core.evaluation.query_result import CONVERTER, QueryResult
from ltvn_core.structured_text import parse_json

SUFFIX = ".gz"
MAX_BYTES = 256_000_000
"""Maximum size of an unpacked file in bytes; 50 times the largest result so far."""


def packed_path(path: Path) -> Path:
    """Return the path of the gzipped file of a result."""
    return path.with_name(path.name + SUFFIX)


def is_stored(path: Path) -> bool:
    """Tell whether a result exists at a path, gzipped or not."""
    return path.exists() or packed_path(path).exists()


def stored_results(folder: Path, pattern: str) -> Iterator[Path]:
    """Yield the results below a folder whose names match, in order; a plain file precedes its gzipped one."""
    plain = set(folder.rglob(pattern))
    packed = {path for path in folder.rglob(pattern + SUFFIX) if path.with_suffix("") not in plain}
    yield from sorted(plain | packed)


def read_result_text(path: Path) -> str:
    """Return the text of a result, which may be gzipped.

    Raises OSError, OptionError for an invalid gzip file or one that is too large, and ValueError for invalid text.
    """
    if path.suffix != SUFFIX and not path.exists() and packed_path(path).exists():
        path = packed_path(path)
    return _unpacked(path) if path.suffix == SUFFIX else path.read_text(encoding="utf-8")


def pack(path: Path) -> Path:
    """Replace a result by its gzipped file and return the new path. Raises RecordingError if that file exists."""
    packed = packed_path(path)
    with atomic_output(packed) as part:
        part.write_bytes(gzip.compress(path.read_bytes(), compresslevel=9, mtime=0))
    path.unlink()
    return packed


def _unpacked(path: Path) -> str:
    try:
        with gzip.open(path) as file:
            content = file.read(MAX_BYTES + 1)
    except (gzip.BadGzipFile, EOFError, zlib.error) as error:
        raise OptionError(f"{path} is damaged, or not packed by gzip: {error}.") from error
    if len(content) > MAX_BYTES:
        raise OptionError(f"{path} unpacks to more than {MAX_BYTES // 1_000_000} MB, which is too large for a result.")
    return content.decode("utf-8")


@dataclass(frozen=True, slots=True)
class MapTruthMetrics:
    """The size of a map and its errors by the ground truth."""

    nodes: int
    edges: int
    """Number of directed edges."""
    spurious_edges: int
    """Number of directed edges that are spurious."""
    pieces: int
    """Number of strongly connected components; 1 is ideal."""
    goals_connected: int
    """Number of goals that can be reached from most of the map."""
    goals_told: int | None = None
    """Number of goals that the map reports as doubtful before any drive; None in older results."""
    goals_told_rightly: int | None = None
    """Number of doubtful goals to which indeed no drivable path leads from most of the map."""
    goals_untold: int | None = None
    """Number of goals to which no drivable path leads from most of the map, but that are not reported as doubtful."""


@dataclass(frozen=True, slots=True)
class MapDrawing:
    """A map over the floor plan of its scene, for drawing."""

    origin: tuple[float, float]
    """x and y of the lower corner of the first cell, in metres."""
    resolution_m: float
    free: tuple[str, ...]
    """Rows from low y to high y, one character per cell: "." is navigable, "#" is not."""
    nodes: tuple[tuple[int, float, float, float], ...]
    """Number of each node, with its exact x and y in metres and yaw in radians."""
    edges: tuple[tuple[int, int, float, bool], ...]
    """Source, target, p, and whether it is spurious."""


@dataclass(frozen=True, slots=True)
class TrialResult:
    """All episodes of one method in one scene with one map seed."""

    scene: str
    method: str
    """Name of the system, such as `ltvn`, `sptm` or `ving`."""
    preset: str
    """Preset of the navigator: `robust` or `paper`."""
    without: tuple[str, ...]
    """Parts of the method that were switched off."""
    finetuned: bool
    seed: int
    queries: int
    """Number of queries with maintenance before these episodes; 0 for the map as it was built."""
    images: int
    """Number of images of the mapping drive."""
    fingerprint: str
    """Fingerprint of the weights in use."""
    map: MapTruthMetrics
    floorplan: MapDrawing | None
    """Drawing of the map. None when read from a file, because the drawing is a separate file (see `save_drawing`);
    older files contain it."""
    episodes: tuple[QueryResult, ...]
    wall_s: float
    """Real time of the episodes, summed over all processes, in seconds."""
    version: str
    command: str
    """Command that reproduces this result."""
    without_depth: int = 0
    """Number of images of the mapping drive without depth."""
    perturbations: tuple[str, ...] = ()
    """Perturbations of the robot's camera in the episodes."""
    conditions: tuple[str, ...] = ()
    """Harder conditions than usual, see `evaluation.protocol`."""


@dataclass(frozen=True, slots=True)
class EdgeCalibrationBin:
    """Edges with p in one bin, and the number of drivable edges among them."""

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
    """The map and the static tests after 0, 100, 200, ... queries."""
    queries: tuple[QueryResult, ...]
    version: str
    command: str
    maintenance: str | None = None
    """Name of the maintenance; None is that of the system."""


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
    """Number of nodes of the map before the first query."""
    edges: int
    """Number of edges of the map before the first query."""
    true_edges: int
    """Number of edges of that map that are not spurious."""
    doors: tuple[DoorMove, ...]
    queries: tuple[QueryResult, ...]
    wall_s: float
    version: str
    command: str


def save_results(path: Path, results: Any) -> None:
    """Write one of these dataclasses as JSON to a new file, atomically. Raises RecordingError."""
    write_text_atomically(path, json.dumps(CONVERTER.unstructure(results), separators=(",", ":")))


def load_results(path: Path, kind: type) -> Any:
    """Read results from `save_results`, gzipped or not. Raises OptionError for any other file."""
    try:
        return CONVERTER.structure(parse_json(read_result_text(path)), kind)
    except OSError as error:
        raise OptionError(f"{path} cannot be read: {error.strerror}.") from error
    except (ValueError, TypeError, AttributeError, cattrs.BaseValidationError) as error:
        raise OptionError(f"{path} is not a {kind.__name__} of this version: {error}.") from error


_PER_METRE = 1000
"""Number of steps per metre, per radian and per unit of p in stored drawings; finer than any figure shows."""


def drawing_path(folder: Path, label: str, queries: int) -> Path:
    """Return the path of the drawing of a method's map after a number of queries with maintenance."""
    return folder / f"{label}-map-{queries:04d}.npz"


def save_drawing(path: Path, drawing: MapDrawing) -> None:
    """Write a drawing to a new file, atomically. Raises RecordingError.

    Nodes and edges are sorted and stored as differences, because those compress well.
    """
    nodes = sorted(drawing.nodes)
    rows = {node: row for row, (node, *_) in enumerate(nodes)}
    edges = sorted((rows[source], rows[target], p, spurious) for source, target, p, spurious in drawing.edges)
    free = np.array([[cell == "." for cell in row] for row in drawing.free], bool)
    with atomic_output(path) as part, part.open("wb") as file:
        np.savez_compressed(
            file,
            origin=np.array(drawing.origin, np.float64),
            resolution_m=np.float64(drawing.resolution_m),
            shape=np.array(free.shape if free.size else (0, 0), np.int32),
            free=np.packbits(free),
            nodes=_differences([node for node, *_ in nodes]),
            poses=np.diff(_thousandths([pose for _, *pose in nodes]).reshape(-1, 3), axis=0, prepend=0),
            sources=_differences([source for source, *_ in edges]),
            targets=_differences([target for _, target, *_ in edges]),
            p=_thousandths([p for _, _, p, _ in edges]).astype(np.uint16),
            spurious=np.packbits(np.array([spurious for *_, spurious in edges], bool)),
        )


def load_drawing(path: Path) -> MapDrawing:
    """Read a drawing from `save_drawing`. Raises OptionError for any other file."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
            return _drawing({name: arrays[name] for name in arrays.files})
    except (OSError, ValueError, KeyError, IndexError, EOFError, BadZipFile) as error:
        raise OptionError(f"{path} is not a drawing of a map ({error}); remove it and evaluate again.") from error


def _drawing(arrays: dict[str, np.ndarray]) -> MapDrawing:
    height, width = arrays["shape"].tolist()
    free = np.unpackbits(arrays["free"], count=height * width).reshape(height, width)
    names = np.cumsum(arrays["nodes"])
    poses = np.cumsum(arrays["poses"], axis=0) / _PER_METRE
    sources = names[np.cumsum(arrays["sources"])]
    targets = names[np.cumsum(arrays["targets"])]
    spurious = np.unpackbits(arrays["spurious"], count=len(sources)).astype(bool)
    p = arrays["p"] / _PER_METRE
    x_m, y_m = arrays["origin"].tolist()
    return MapDrawing(
        origin=(x_m, y_m),
        resolution_m=float(arrays["resolution_m"]),
        free=tuple("".join(row) for row in np.where(free, ".", "#")),
        nodes=tuple((node, *pose) for node, pose in zip(names.tolist(), poses.tolist(), strict=True)),
        edges=tuple(zip(sources.tolist(), targets.tolist(), p.tolist(), spurious.tolist(), strict=True)),
    )


def _thousandths(values: list) -> np.ndarray:
    return np.rint(np.array(values, np.float64) * _PER_METRE).astype(np.int32)


def _differences(values: list[int]) -> np.ndarray:
    return np.diff(np.array(values, np.int32), prepend=0)
