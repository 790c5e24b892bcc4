"""Results of evaluations: one line of JSON for each query, and one for each map that queries begin with.

Every line has the columns of its run (`RunColumns`), so a table program can group the lines as they are. A query has
those of `QueryResult`, a map those of `TestedMap`. A run is all lines with the same columns, in any number of files
`*.jsonl` of one folder, which may be gzipped; nothing is ever merged. Names of columns must not change. The drawing of
a map is a file beside them.
"""

import gzip
import json
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import cattrs

from ltvn_core.atomic_files import write_text_atomically
from ltvn_core.errors import OptionError
from ltvn_core.evaluation.map_drawing import MapDrawing
from ltvn_core.evaluation.query_result import CONVERTER, QueryResult, append_durably
from ltvn_core.structured_text import parse_json

ROWS = "*.jsonl"
MAX_BYTES = 256_000_000
"""Maximum size of an unpacked file in bytes; 50 times the largest result so far."""
OWN_MAINTENANCE = "own"
"""Maintenance of a run that uses the one of its system."""
_DAY_S = 86_400


@dataclass(frozen=True, slots=True, kw_only=True)
class RunColumns:
    """The columns that all lines of one run share."""

    scene: str
    seed: int
    method: str
    """Name of the system, such as `ltvn`, `sptm` or `ving`."""
    preset: str
    """Preset of the navigator: `robust` or `paper`."""
    without: tuple[str, ...] = ()
    """Parts of the method that were switched off."""
    finetuned: bool
    predictor: str
    """Name of the predictor."""
    perturbations: tuple[str, ...] = ()
    """Perturbations of the robot's camera in the episodes."""
    conditions: tuple[str, ...] = ()
    """Harder conditions than usual, see `evaluation.protocol`."""
    maintenance: str | None = None
    """Name of the maintenance, `own` for that of the system; None if no query changes the map."""
    world: str | None = None
    """Script of the changing world."""
    days: float | None = None
    """Number of simulated days in the changing world."""


@dataclass(frozen=True, slots=True)
class MapTruthMetrics:
    """The size of a map and its errors by the ground truth."""

    nodes: int
    edges: int
    """Number of directed edges."""
    spurious_edges: int
    """Number of directed edges that are spurious."""
    pieces: int
    """Number of strongly connected components; 1 is ideal, 0 is unknown."""
    goals_connected: int
    """Number of goals that can be reached from most of the map."""
    goals_told: int | None = None
    """Number of goals that the map reports as doubtful before any drive; None in older results."""
    goals_told_rightly: int | None = None
    """Number of doubtful goals to which indeed no drivable path leads from most of the map."""
    goals_untold: int | None = None
    """Number of goals to which no drivable path leads from most of the map, but that are not reported as doubtful."""


@dataclass(frozen=True, slots=True)
class EdgeCalibrationBin:
    """Edges with p in one bin, and the number of drivable edges among them."""

    low: float
    high: float
    edges: int
    mean_p: float
    drivable: float


@dataclass(frozen=True, slots=True)
class DoorMove:
    """A door was closed or opened by the script."""

    at_s: float
    door: int
    is_open: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class TestedMap:
    """A map after some queries with maintenance, and the episodes that began with it and did not change it."""

    columns: RunColumns
    after: int = 0
    """Number of queries with maintenance before; 0 for the map as it was built."""
    images: int
    """Number of images of the mapping drive."""
    without_depth: int = 0
    """Number of images of the mapping drive without depth."""
    fingerprint: str
    """Fingerprint of the weights in use."""
    map: MapTruthMetrics
    calibration: tuple[EdgeCalibrationBin, ...] = ()
    """Calibration of p."""
    doors: tuple[DoorMove, ...] = ()
    """Doors that the script of the world moves."""
    version: str
    command: str
    """Command that reproduces this result."""
    episodes: tuple[QueryResult, ...] = ()
    floorplan: MapDrawing | None = None
    """Drawing of the map, which is a file beside the lines."""

    __test__ = False


@dataclass(frozen=True, slots=True)
class Run:
    """All results of one plan: its maps with their episodes, and the queries that changed the map."""

    columns: RunColumns
    maps: tuple[TestedMap, ...]
    """The map at each test, in order; in a changing world only the map before the queries."""
    queries: tuple[QueryResult, ...] = ()
    """Queries with maintenance, in order."""
    folder: Path | None = None
    """Folder of the lines."""


def columns_line(columns: RunColumns, result: QueryResult | TestedMap) -> str:
    """Return a query or map as a line of JSON, with the columns of its run first."""
    line: dict[str, Any] = CONVERTER.unstructure(result)
    for name in ("columns", "episodes", "floorplan"):
        line.pop(name, None)
    day = {"day": int(result.at_s // _DAY_S) + 1} if columns.world and isinstance(result, QueryResult) else {}
    return json.dumps(CONVERTER.unstructure(columns) | day | line, separators=(",", ":"))


def json_rows(runs: Iterable[Run]) -> str:
    """Return all lines of some runs as one JSON list."""
    lines = (
        columns_line(run.columns, result)
        for run in runs
        for known in run.maps
        for result in (known, *known.episodes, *(run.queries if known is run.maps[0] else ()))
    )
    return "[" + ",\n".join(lines) + "]\n"


def append_rows(path: Path, columns: RunColumns, results: Iterable[QueryResult | TestedMap]) -> None:
    """Append lines to a file and flush it to disk. Raises OptionError if it cannot be written."""
    append_durably(path, "".join(f"\n{columns_line(columns, result)}" for result in results))


def drawing_path(folder: Path, queries: int) -> Path:
    """Return the path of the drawing of a run's map after a number of queries with maintenance."""
    return folder / f"map-{queries:04d}.npz"


def failure_path(folder: Path, episode: int) -> Path:
    """Return the path of a run's recording of a failed episode."""
    return folder / f"failure-{episode:04d}.rrd"


def rows_in(folder: Path) -> list[Path]:
    """Return the files with lines of results below a folder, in order."""
    return sorted(path for pattern in (ROWS, f"{ROWS}.gz") for path in folder.rglob(pattern))


def read_runs(paths: Iterable[Path]) -> tuple[Run, ...]:
    """Read the lines in some files, and group them by run.

    An incomplete line is ignored, so the query of that line counts as missing; of two lines about one query, the last
    one counts.

    Raises:
        OptionError: A file is damaged or has a line with other columns, or two folders have results of one run.
    """
    maps: dict[RunColumns, dict[int, TestedMap]] = {}
    queries: dict[RunColumns, dict[tuple[int | None, int], QueryResult]] = {}
    folders: dict[RunColumns, Path] = {}
    for path in paths:
        for columns, result in _read_rows(path):
            if (folder := folders.setdefault(columns, path.parent)) != path.parent:
                raise OptionError(f"{folder} and {path.parent} have results of the same run; move one of them away.")
            if isinstance(result, TestedMap):
                maps.setdefault(columns, {})[result.after] = result
            else:
                queries.setdefault(columns, {})[result.after, result.query] = result
    return tuple(
        _run(columns, maps.get(columns, {}), queries.get(columns, {}), folder) for columns, folder in folders.items()
    )


def read_queries(path: Path) -> list[QueryResult]:
    """Return the queries and episodes in a file in its order; none if it does not exist."""
    return [result for _, result in _read_rows(path) if isinstance(result, QueryResult)] if path.exists() else []


def _run(
    columns: RunColumns,
    maps: dict[int, TestedMap],
    queries: dict[tuple[int | None, int], QueryResult],
    folder: Path,
) -> Run:
    episodes: dict[int | None, list[QueryResult]] = {}
    for (after, _), result in sorted(queries.items(), key=lambda each: each[0][1]):
        episodes.setdefault(after, []).append(result)
    tested = (replace(known, episodes=tuple(episodes.get(after, ()))) for after, known in sorted(maps.items()))
    return Run(columns, tuple(tested), tuple(episodes.get(None, ())), folder)


_RUN_COLUMNS = frozenset(field.name for field in fields(RunColumns))


def _read_rows(path: Path) -> Iterator[tuple[RunColumns, QueryResult | TestedMap]]:
    for text in _text(path).splitlines():
        try:
            line = parse_json(text)
        except ValueError:
            continue
        try:
            line.pop("day", None)
            columns = {name: line.pop(name) for name in _RUN_COLUMNS & line.keys()}
            found = CONVERTER.structure(columns, RunColumns)
            if "map" in line:
                yield found, CONVERTER.structure({"columns": columns, **line}, TestedMap)
            else:
                yield found, CONVERTER.structure(line, QueryResult)
        except (ValueError, TypeError, AttributeError, cattrs.BaseValidationError) as error:
            raise OptionError(f"{path} has a line that is no result of this version: {error}.") from error


def _text(path: Path) -> str:
    try:
        with gzip.open(path) if path.suffix == ".gz" else path.open("rb") as file:
            content = file.read(MAX_BYTES + 1)
    except (gzip.BadGzipFile, EOFError, zlib.error) as error:
        raise OptionError(f"{path} is damaged, or not packed by gzip: {error}.") from error
    except OSError as error:
        raise OptionError(f"{path} cannot be read: {error.strerror}.") from error
    if len(content) > MAX_BYTES:
        raise OptionError(f"{path} has more than {MAX_BYTES // 1_000_000} MB, which is too much for results.")
    return content.decode("utf-8", errors="replace")


def save_results(path: Path, results: Any) -> None:
    """Write one of these dataclasses of an evaluation as JSON to a new file, atomically. Raises RecordingError."""
    write_text_atomically(path, json.dumps(CONVERTER.unstructure(results), separators=(",", ":")))


def load_results(path: Path, kind: type) -> Any:
    """Read what `save_results` wrote. Raises OptionError for any other file."""
    try:
        return CONVERTER.structure(parse_json(path.read_text(encoding="utf-8")), kind)
    except OSError as error:
        raise OptionError(f"{path} cannot be read: {error.strerror}.") from error
    except (ValueError, TypeError, AttributeError, cattrs.BaseValidationError) as error:
        raise OptionError(f"{path} is not a {kind.__name__} of this version: {error}.") from error
