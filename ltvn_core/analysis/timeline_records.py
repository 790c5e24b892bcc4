"""The queries, attempts, plans, map changes and marks of a run, as rows with indices into the list of its events.

Holds data only. Each result of the analysis links to a moment of the run by an `Instant`. `analysis.timeline_rows`
makes the rows, and `analysis.timeline` looks them up.
"""

import itertools
from dataclasses import dataclass
from typing import NamedTuple

from ltvn_core.graph.deltas import GraphDelta
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.navigation.event_table import MarkKind, describe_event, edges_between
from ltvn_core.navigation.events import (
    AttemptEnded,
    AttemptStarted,
    Event,
    Judged,
    Localised,
    Outcome,
    Planned,
    QueryEnded,
)
from ltvn_core.types import FrameId, NodeId


class Instant(NamedTuple):
    """A moment of a run that the page can jump to."""

    step: FrameId
    stamp: float
    """Seconds on the robot's clock."""


class Mark(NamedTuple):
    """A moment that the user can step to."""

    kind: MarkKind
    instant: Instant
    event: int
    """Index in the timeline's events."""
    ids: tuple[NodeId, ...]
    """The nodes that the mark is about; source and target of an edge."""
    happened: Event | str
    """The event, or a line about it."""

    @property
    def text(self) -> str:
        """One line about the event, put into words only when it is shown."""
        return self.happened if isinstance(self.happened, str) else describe_event(self.happened).text


class MapChange(NamedTuple):
    """A change of the map."""

    event: int
    """Index in the timeline's events."""
    instant: Instant
    epoch: int
    """Index of the map in the recording."""
    version: int
    """Number of changes of this map including this one, as in `TopologicalGraph.version`."""
    delta: GraphDelta
    query: int | None
    attempt: int | None


class PlanRecord(NamedTuple):
    """A plan, with the localisation from which it was made."""

    event: int
    """Index in the timeline's events."""
    instant: Instant
    planned: Planned
    localised: Localised | None
    previous: tuple[NodeId, ...] | None
    """The previous path of the query; None for the first plan."""

    @property
    def place_p(self) -> float | None:
        """Probability of the robot's likeliest place; None if unknown."""
        if self.planned.place_p is not None or self.localised is None:
            return self.planned.place_p
        return self.localised.probability  # An older recording.

    @property
    def edges(self) -> tuple[EdgeKey, ...]:
        """The edges of the path; empty without a path."""
        return tuple(itertools.pairwise(self.planned.nodes))


@dataclass(frozen=True, slots=True)
class AttemptRecord:
    """An attempt to drive to a node, from start to verdict."""

    event: int
    """Index of its start in the timeline's events."""
    begin: Instant
    started: AttemptStarted
    plan: PlanRecord | None
    """The plan that the robot followed; None if it is unknown."""
    end: Instant | None
    """The instant of the verdict; None if the recording ends before."""
    ended: AttemptEnded | None

    @property
    def failed(self) -> bool:
        """Whether the attempt ended without success."""
        return self.ended is not None and not self.ended.succeeded

    @property
    def edges(self) -> tuple[EdgeKey, ...]:
        """The edges of the attempt: several if the subgoal was farther ahead, none for the approach to a node."""
        if self.started.source is None:
            return ()
        planned = self.plan.planned.nodes if self.plan else ()
        return edges_between(planned, self.started.source, self.started.target)


@dataclass(frozen=True, slots=True, repr=False)
class QueryRecord:
    """A query from start to end."""

    id: int
    goal: NodeId
    epoch: int
    """Index of the map in which the query ran."""
    first: int
    """Index of its first event in the timeline's events."""
    last: int
    """Index of its last event in the timeline's events; the verdict of the evaluation follows it."""
    begin: Instant
    end: Instant | None
    """The instant of its end; None if the recording ends before, or another query starts."""
    ended: QueryEnded | None
    judged: Judged | None
    """The evaluation's verdict; None outside simulation."""
    attempts: tuple[AttemptRecord, ...]
    plans: tuple[PlanRecord, ...]

    def __repr__(self) -> str:
        ended = f"{self.outcome} at {self.end.stamp:.1f} s" if self.end else "cut off"
        attempts = f"{len(self.attempts)} attempt{'s' * (len(self.attempts) != 1)}"
        return f"<QueryRecord {self.id} to node {self.goal}: {attempts} from {self.begin.stamp:.1f} s, {ended}>"

    @property
    def outcome(self) -> Outcome | None:
        """The outcome by the robot's own judgement; None if the query was cut."""
        return self.ended.outcome if self.ended else None

    @property
    def succeeded(self) -> bool | None:
        """Whether the robot declared arrival and no verdict contradicts it; None for an unfinished or cancelled
        query."""
        if self.outcome in (None, Outcome.CANCELLED):
            return None
        return self.outcome is Outcome.ARRIVED and (self.judged is None or self.judged.reached)
