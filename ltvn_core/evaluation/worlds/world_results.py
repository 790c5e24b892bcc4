"""The results of queries in a changing world as plain data. Field names are the keys of the JSON files, so they stay.

`world_metrics` computes the metrics over results.
"""

from dataclasses import dataclass, field

from ltvn_core.evaluation.encounters import EncounterCounts
from ltvn_core.evaluation.results import FailureCause
from ltvn_core.types import FrameId, NodeId


@dataclass(frozen=True, slots=True)
class PresenceBin:
    """Predictions of presence in one tenth of the range from 0 to 1."""

    predictions: int
    mean_p: float
    """Mean prediction,"""
    present: float
    """and share of the edges that were open."""


@dataclass(frozen=True, slots=True)
class PresenceScore:
    """How good the predictions of one moment were, over the edges that the world ever closes."""

    predictions: int
    brier: float
    """Mean squared error."""
    bins: tuple[PresenceBin, ...]
    """Ten bins of equal width."""


@dataclass(frozen=True, slots=True)
class WorldQuery:
    """One query in a changing world."""

    query: int
    at_s: float
    """When it began: seconds from midnight of the first day."""
    start: FrameId
    goal: NodeId
    reached: bool
    """Within 0.72 m and 0.4 rad by the robot's own decision (paper)."""
    outcome: str
    failure: FailureCause | None
    """As the ground truth of the scene as it was made tells; None where the goal was reached."""
    cut_off: bool
    """It failed, and at its end there was no way to the goal any more."""
    steps: int
    collisions: int
    path_m: float
    shortest_m: float
    """Length of the shortest way at the moment when it began."""
    blocked_tries: int
    """Attempts along edges that were closed at that moment."""
    doors_tried: tuple[int, ...]
    """Closed doors that it met: on these edges, or on edges of which the map learned that they are closed."""
    doors_wanted: tuple[int, ...]
    """Doors that the map's best way led through at the beginning, if one knew which edges were open."""
    doors_used: tuple[int, ...]
    """Doors on edges that were driven with success."""
    now: PresenceScore
    """Predictions at the beginning for that moment,"""
    later: PresenceScore
    """and for an hour later."""
    nodes: int
    """In the map afterwards."""
    edges: int
    lost_edges: int
    """True edges of the first map that are gone for ever."""
    people: EncounterCounts = field(default_factory=EncounterCounts)
    """Whom the robot met on the way."""
    detour_m: float = 0.0
    """How much longer the shortest way was than in the scene as it was made."""
    door_tries: int | None = None
    """Attempts through doors that were closed at that moment; None in older results, of worlds where only doors move,
    so that they are the same as `blocked_tries`."""

    @property
    def spl(self) -> float:
        """Success weighted by path length (Anderson et al. 2018), in [0, 1]."""
        return self.shortest_m / max(self.path_m, self.shortest_m, 1e-9) if self.reached else 0.0


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
    """Of the map before the first query,"""
    edges: int
    true_edges: int
    """and those of its edges that are not spurious."""
    doors: tuple[DoorMove, ...]
    queries: tuple[WorldQuery, ...]
    wall_s: float
    version: str
    command: str
