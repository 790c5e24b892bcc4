"""What became of a query, as one row of a table, and the log of such rows.

Every runner of queries fills the columns that it knows. Field names are the keys of the JSON files and of the logs, so
they stay; `CONVERTER` knows older ones. The log of an unfinished test has one line of JSON for each query, on disk as
soon as the query is over: a test that is begun again reads it and runs only what is missing. Several processes that
share a folder may append to one; a query that stands there twice counts once, by its last line.
"""

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import cattrs
from cattrs.gen import make_dict_structure_fn, make_dict_unstructure_fn

from ltvn_core.errors import OptionError
from ltvn_core.structured_text import parse_json
from ltvn_core.types import FrameId, NodeId


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
class PresenceBin:
    """Predictions of presence in one tenth of the range from 0 to 1."""

    predictions: int
    mean_p: float
    """Mean prediction."""
    present: float
    """Share of the edges that were open."""


@dataclass(frozen=True, slots=True)
class PresenceScore:
    """How good the predictions of one moment were, over the edges that the world ever closes."""

    predictions: int
    brier: float
    """Mean squared error."""
    bins: tuple[PresenceBin, ...]
    """Ten bins of equal width."""


@dataclass(frozen=True, slots=True)
class EncounterCounts:
    """Several encounters with people in numbers."""

    encounters: int = 0
    gave_way: int = 0
    """In which the person had to step aside."""
    touched: int = 0
    avoidable: int = 0
    """Touches that an attentive driver would have avoided."""
    closest_m: float | None = None
    """Least distance from surface to surface; None where nobody was met."""
    closest_each_m: tuple[float, ...] = ()
    """The same of each encounter, in whole millimetres."""
    stood_s: float = 0.0
    """Seconds for which the robot stood still in encounters; twice where there were two at once."""

    def __add__(self, other: "EncounterCounts") -> "EncounterCounts":
        """Count both."""
        closest = [each for each in (self.closest_m, other.closest_m) if each is not None]
        return EncounterCounts(
            encounters=self.encounters + other.encounters,
            gave_way=self.gave_way + other.gave_way,
            touched=self.touched + other.touched,
            avoidable=self.avoidable + other.avoidable,
            closest_m=min(closest, default=None),
            closest_each_m=self.closest_each_m + other.closest_each_m,
            stood_s=round(self.stood_s + other.stood_s, 1),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class QueryResult:
    """What became of one query; a column that its runner does not know holds its default."""

    query: int
    """Number of the query or episode in its test, from 0."""
    reached: bool
    """Within 0.72 m and 0.4 rad (paper), and in episodes by the robot's own decision; by its belief without truth."""
    outcome: str
    """How it ended, as the robot sees it, see `navigation.events.Outcome`; "gone" where the map had lost the goal."""
    start: FrameId | None = None
    """Image of the mapping drive at whose exact pose the robot started."""
    goal: NodeId | None = None
    """The goal image; None in older results of lifelong tests."""
    steps: int = 0
    collisions: int = 0
    path_m: float = 0.0
    """Driven length by odometry."""

    # What it changed in the map.
    pruned: int = 0
    """Edges that left the map."""
    added_nodes: int = 0
    added_edges: int = 0
    nodes: int = 0
    """In the map afterwards."""
    edges: int = 0
    """In the map afterwards."""

    # By the ground truth.
    failure: FailureCause | None = None
    """None where the goal was reached."""
    trigger: FailureCause | None = None
    """The first cause since the last correct localisation; may differ from the one with most steps."""
    shortest_m: float | None = None
    """Length of the shortest feasible path from start to goal when the query began."""
    position_error_m: float | None = None
    """Distance from the goal at the end."""
    yaw_error_rad: float | None = None
    checkpoints: int | None = None
    """Checkpoints on the way from start to goal, see `episode_runner.Checkpoints`."""
    crossed: int | None = None
    """How many of them the robot crossed."""
    localised: int | None = None
    """Localisations that found a node."""
    mislocalised: int | None = None
    """Those of them at a node where the robot was not, most often one that looks alike."""
    spurious_edges: int = 0
    """Spurious edges in the map afterwards."""
    pruned_bad: int = 0
    """Pruned edges that are spurious or could not be driven by the robot."""
    pruned_spurious: int = 0
    """Pruned edges that are spurious."""
    added_spurious: int = 0
    """Added edges that are spurious."""

    # In a world that changes.
    at_s: float = 0.0
    """When it began: seconds from midnight of the first day."""
    cut_off: bool = False
    """It failed, and at its end there was no way to the goal any more."""
    detour_m: float = 0.0
    """How much longer the shortest way was than in the scene as it was made."""
    blocked_tries: int = 0
    """Attempts along edges that were closed at that moment."""
    door_tries: int | None = None
    """Attempts through doors that were closed at that moment; None in older results, of worlds where only doors move,
    so that they are the same as `blocked_tries`."""
    doors_tried: tuple[int, ...] = ()
    """Closed doors that it met: on these edges, or on edges of which the map learned that they are closed."""
    doors_wanted: tuple[int, ...] = ()
    """Doors that the map's best way led through at the beginning, if one knew which edges were open."""
    doors_used: tuple[int, ...] = ()
    """Doors on edges that were driven with success."""
    now: PresenceScore | None = None
    """Predictions at the beginning for that moment."""
    later: PresenceScore | None = None
    """Predictions at the beginning for an hour later."""
    lost_edges: int = 0
    """True edges of the first map that are gone for ever."""
    people: EncounterCounts = EncounterCounts()
    """Whom the robot met on the way."""

    # In a log of single queries.
    phase: str | None = None
    """Part of a test on a robot to which it belongs."""
    judged_by: str | None = None
    """Who says whether it was reached, on a robot: truth (its true pose), person, or belief (the robot itself)."""
    seconds: float | None = None
    """Time on the wall's clock that it took."""

    @property
    def spl(self) -> float:
        """Success weighted by path length (Anderson et al. 2018), in [0, 1]; 0 where no path length is known."""
        if not self.reached or self.shortest_m is None:
            return 0.0
        return self.shortest_m / max(self.path_m, self.shortest_m, 1e-9)


@dataclass(frozen=True, slots=True)
class QueryBatch:
    """The results of some queries that were run one after the other."""

    queries: tuple[QueryResult, ...]
    wall_s: float


CONVERTER = cattrs.Converter(forbid_extra_keys=True)
"""Reads and writes results of evaluations; a row is written without the columns that nobody filled."""

_OLDER_COLUMNS = {"episode": "query", "number": "query", "away_m": "position_error_m", "added": "added_edges"}
"""Keys of older rows; of `added` it is not known any more how many were nodes."""


def _read_older(kind: type, older: Mapping[str, str]) -> None:
    """Let records of a kind be read that have older keys."""
    read = make_dict_structure_fn(kind, CONVERTER, _cattrs_forbid_extra_keys=True)
    CONVERTER.register_structure_hook(
        kind, lambda found, _: read({older.get(name, name): value for name, value in found.items()}, kind)
    )


_read_older(QueryResult, _OLDER_COLUMNS)
_read_older(QueryBatch, {"episodes": "queries"})
CONVERTER.register_unstructure_hook(
    QueryResult, make_dict_unstructure_fn(QueryResult, CONVERTER, _cattrs_omit_if_default=True)
)


def read_query_log(path: Path) -> list[QueryResult]:
    """Return the finished queries in order; a line that was cut off is left out, so that its query is run again."""
    if not path.exists():
        return []
    found: dict[tuple[str, int], QueryResult] = {}
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        try:
            result = CONVERTER.structure(parse_json(line), QueryResult)
        except (ValueError, TypeError, AttributeError, cattrs.BaseValidationError):
            continue
        found[result.phase or "", result.query] = result
    return list(found.values())


def append_to_log(path: Path, result: QueryResult) -> None:
    """Add a finished query; it is on the disk when this returns. Raises OptionError where it cannot be written."""
    line = json.dumps(CONVERTER.unstructure(result), separators=(",", ":"))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("a", encoding="utf-8") as file:
            # The line break stands first, so that a line that was cut off spoils no other.
            file.write(f"\n{line}" if file.tell() else line)
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise OptionError(
            f"{path} cannot be written: {error.strerror}. Free some space or name another --folder; what is done is "
            "kept."
        ) from error
