"""The result of a query, as one row of a table, and the log of such rows.

Each runner of queries fills the columns that it knows. Field names are the keys of the JSON files and of the logs, so
they must not change. The log of an unfinished test has one line of JSON per query,
written to disk as soon as the query is over. A restarted test reads the log and runs only the missing queries. Several
processes that share a folder may append to one log; if a query has two lines, the last line counts.
"""

import json
import os
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

import cattrs
from cattrs.gen import make_dict_unstructure_fn

from ltvn_core.errors import OptionError
from ltvn_core.structured_text import parse_json
from ltvn_core.types import FrameId, NodeId


class FailureCause(StrEnum):
    """Cause of the failure of an episode, by the ground truth."""

    WRONG_ARRIVAL = "wrong arrival"
    """The robot decided that it had arrived, but it had not."""
    SPURIOUS_EDGE = "spurious edge"
    """The robot spent its time on spurious edges."""
    MISLOCALISED = "mis-localised"
    """The robot localised at a node where it was not."""
    COLLISION = "collision"
    """The controller collided too often, or was blocked."""
    NO_PATH = "no path"
    """The map has no path to the goal."""
    STEP_LIMIT = "step limit"
    """The robot reached the step limit without another cause."""


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
    """Score of the predictions for one time, over the edges that the world ever closes."""

    predictions: int
    brier: float
    """Mean squared error."""
    bins: tuple[PresenceBin, ...]
    """Ten bins of equal width."""


@dataclass(frozen=True, slots=True)
class EncounterCounts:
    """Counts over several encounters with people."""

    encounters: int = 0
    gave_way: int = 0
    """Number of encounters in which the person had to step aside."""
    touched: int = 0
    avoidable: int = 0
    """Number of contacts that an attentive driver would have avoided."""
    closest_m: float | None = None
    """Least distance from surface to surface, in metres; None without encounters."""
    closest_each_m: tuple[float, ...] = ()
    """Least distance of each encounter, in metres, rounded to millimetres."""
    stood_s: float = 0.0
    """Time for which the robot stood still in encounters, in seconds; simultaneous encounters count separately."""

    def __add__(self, other: "EncounterCounts") -> "EncounterCounts":
        """Return the sums of two counts."""
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
    """Result of one query; columns that its runner does not know have their defaults."""

    query: int
    """Number of the query or episode in its test, from 0."""
    reached: bool
    """Whether the robot ended within 0.72 m and 0.4 rad of the goal (paper). In episodes, the robot must also have
    decided that it arrived. Without ground truth, a person's judgement or the robot's own decision counts, see
    `judged_by`."""
    outcome: str
    """Outcome by the robot's own judgement, see `navigation.events.Outcome`; "gone" if the map no longer had the
    goal."""
    after: int | None = None
    """Number of queries with maintenance before this episode, which does not change the map; None for a query that may
    change it."""
    start: FrameId | None = None
    """Image of the mapping drive at whose exact pose the robot started."""
    goal: NodeId | None = None
    """The goal image; None in older results of lifelong tests."""
    steps: int = 0
    collisions: int = 0
    path_m: float = 0.0
    """Driven length by odometry, in metres."""

    # Changes of the map.
    pruned: int = 0
    """Number of pruned edges."""
    added_nodes: int = 0
    added_edges: int = 0
    nodes: int = 0
    """Number of nodes in the map after the query."""
    edges: int = 0
    """Number of edges in the map after the query."""

    # By the ground truth.
    failure: FailureCause | None = None
    """Cause of the failure; None if the goal was reached."""
    trigger: FailureCause | None = None
    """The first cause since the last correct localisation; it may differ from the cause with the most steps."""
    shortest_m: float | None = None
    """Length of the shortest feasible path from start to goal when the query began."""
    position_error_m: float | None = None
    """Distance from the goal at the end, in metres."""
    yaw_error_rad: float | None = None
    checkpoints: int | None = None
    """Number of checkpoints on the path from start to goal, see `episode_runner.Checkpoints`."""
    crossed: int | None = None
    """Number of checkpoints that the robot crossed."""
    localised: int | None = None
    """Number of localisations that found a node."""
    mislocalised: int | None = None
    """Number of localisations at a node where the robot was not, usually a perceptual alias."""
    spurious_edges: int = 0
    """Number of spurious edges in the map after the query."""
    pruned_bad: int = 0
    """Number of pruned edges that are spurious or could not be driven by the robot."""
    pruned_spurious: int = 0
    """Number of pruned edges that are spurious."""
    added_spurious: int = 0
    """Number of added edges that are spurious."""

    # In a world that changes.
    at_s: float = 0.0
    """Start of the query, in seconds from midnight of the first day."""
    cut_off: bool = False
    """Whether the query failed and no path to the goal was open at its end."""
    detour_m: float = 0.0
    """Additional length of the shortest path compared with the unchanged scene, in metres."""
    blocked_tries: int = 0
    """Number of attempts along edges that were closed at that time."""
    door_tries: int | None = None
    """Number of attempts through doors that were closed at that time; None in older results. In those, only doors
    change, so the number equals `blocked_tries`."""
    doors_tried: tuple[int, ...] = ()
    """Closed doors that the robot met: on edges that it tried to drive, or on edges that the map learned to be
    closed."""
    doors_wanted: tuple[int, ...] = ()
    """Doors on the best path through edges of the map that were truly open at the start of the query."""
    doors_used: tuple[int, ...] = ()
    """Doors on edges that were driven successfully."""
    now: PresenceScore | None = None
    """Score of the predictions that were made at the start of the query for that time."""
    later: PresenceScore | None = None
    """Score of the predictions that were made at the start of the query for one hour later."""
    lost_edges: int = 0
    """Number of true edges of the first map that are missing now."""
    people: EncounterCounts = EncounterCounts()
    """Encounters with people during the query."""

    # In a log of single queries.
    phase: str | None = None
    """Part of a test on a robot that the query belongs to."""
    judged_by: str | None = None
    """Source of `reached` on a real robot: truth (its true pose), person, or belief (the robot itself)."""
    seconds: float | None = field(default=None, compare=False)
    """Duration of the query in real time, in seconds."""

    @property
    def spl(self) -> float:
        """Success weighted by path length (Anderson et al. 2018), in [0, 1]; 0 if the path length is unknown."""
        if not self.reached or self.shortest_m is None:
            return 0.0
        return self.shortest_m / max(self.path_m, self.shortest_m, 1e-9)


CONVERTER = cattrs.Converter(forbid_extra_keys=True)
"""Reads and writes results of evaluations; columns with default values are not written."""
CONVERTER.register_unstructure_hook(
    QueryResult, make_dict_unstructure_fn(QueryResult, CONVERTER, _cattrs_omit_if_default=True)
)


def read_query_log(path: Path) -> list[QueryResult]:
    """Return the finished queries in order; an incomplete line is ignored, so the query of that line runs again."""
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
    """Append a finished query and flush it to disk. Raises OptionError if it cannot be written."""
    line = json.dumps(CONVERTER.unstructure(result), separators=(",", ":"))
    append_durably(path, f"\n{line}", break_first=False)


def append_durably(path: Path, text: str, *, break_first: bool = True) -> None:
    """Append lines of results to a file and flush it to disk; its folder is made.

    The text begins with a line break, so that an incomplete line before it does not damage the next one; `break_first`
    tells whether a new file begins with it, too. Raises OptionError if the file cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("a", encoding="utf-8") as file:
            file.write(text if break_first or file.tell() else text.removeprefix("\n"))
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise OptionError(
            f"{path} cannot be written: {error.strerror}. Free some space or name another --folder; the results so "
            "far are kept."
        ) from error
