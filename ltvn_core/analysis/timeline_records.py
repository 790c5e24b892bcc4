"""The queries, attempts, plans, map changes and marks of a run, as rows that point back into the list of its events.

Owns the data alone. An `Instant` is the link by which every result of the analysis can be jumped to. The rows are put
together by `analysis.timeline_rows` and found by `analysis.timeline`.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

from ltvn_core.graph.deltas import GraphDelta
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.navigation.events import AttemptEnded, AttemptStarted, Judged, Localised, Outcome, Planned, QueryEnded
from ltvn_core.types import FrameId, NodeId


class Instant(NamedTuple):
    """A moment of a recording, to jump to."""

    step: FrameId
    stamp: float
    """Seconds on the robot's clock."""


class MarkKind(StrEnum):
    """Kind of a mark on the timeline."""

    MAP = "map"
    """A whole map came in: built, or out of a file."""
    QUERY_START = "query start"
    QUERY_END = "query end"
    PRUNE = "prune"
    """An edge left the map, or a person took a node out."""
    EXPAND = "expand"
    """A node came in because the robot was lost or saw no path."""
    COLLISION = "collision"
    FAILURE = "failure"
    """An attempt did not succeed."""
    REPLAN = "replan"
    """The plan is not the rest of the last one."""
    ADD = "add"
    """A node or an edge came in for another reason, not with a whole map."""
    SEEN_OPEN = "seen open"
    SEEN_BLOCKED = "seen blocked"
    DOOR_OPENED = "door opened"
    DOOR_CLOSED = "door closed"
    WORLD = "world"
    """A thing was put down or taken away, the light changed."""


class Mark(NamedTuple):
    """A moment that one can step to."""

    kind: MarkKind
    instant: Instant
    event: int
    """Index in the timeline's events."""
    ids: tuple[NodeId, ...]
    """The nodes it is about; two of an edge."""
    text: str


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
    """A plan, and where the robot thought it was when it made it."""

    event: int
    """Index in the timeline's events."""
    instant: Instant
    planned: Planned
    localised: Localised | None
    previous: tuple[NodeId, ...] | None
    """The path planned before it in the query; None for the first."""

    @property
    def edges(self) -> tuple[EdgeKey, ...]:
        """The edges of the path; none without a path."""
        return tuple(itertools.pairwise(self.planned.nodes))


@dataclass(frozen=True, slots=True)
class AttemptRecord:
    """An attempt to drive to a node, from departure to verdict."""

    event: int
    """Index of its start in the timeline's events."""
    begin: Instant
    started: AttemptStarted
    plan: PlanRecord | None
    """The plan that was followed."""
    end: Instant | None
    """None if the recording is cut before."""
    ended: AttemptEnded | None
    collisions: int

    @property
    def localised(self) -> Localised | None:
        """Where the robot thought it was before it set off."""
        return self.plan.localised if self.plan else None

    @property
    def failed(self) -> bool:
        """It is over and did not succeed."""
        return self.ended is not None and not self.ended.succeeded

    @property
    def edges(self) -> tuple[EdgeKey, ...]:
        """The edges it drove: several where the subgoal lay farther ahead, none for the approach to a node."""
        if self.started.source is None:
            return ()
        planned = self.plan.planned.nodes if self.plan else ()
        return edges_between(planned, self.started.source, self.started.target)


def edges_between(path: Sequence[NodeId], source: NodeId, target: NodeId) -> tuple[EdgeKey, ...]:
    """Return the edges of a path from one of its nodes to a later one, or the edge that joins the two if it has none.

    An attempt to a subgoal farther ahead drives all of them, and its failure counts against each.
    """
    if source in path and target in path[path.index(source) + 1 :]:
        return tuple(itertools.pairwise(path[path.index(source) : path.index(target) + 1]))
    return ((source, target),)


@dataclass(frozen=True, slots=True)
class QueryRecord:
    """A navigation task from start to end."""

    id: int
    goal: NodeId
    epoch: int
    """Index of the map in which the query ran."""
    first: int
    """Index of its first event in the timeline's events."""
    last: int
    """Index of its last event; the verdict comes right after."""
    begin: Instant
    end: Instant | None
    """None if it was cut: by the end of the recording, or by another query."""
    ended: QueryEnded | None
    judged: Judged | None
    """The evaluation's verdict; None outside simulation."""
    attempts: tuple[AttemptRecord, ...]
    plans: tuple[PlanRecord, ...]

    @property
    def outcome(self) -> Outcome | None:
        """How it ended as the robot sees it, None if it was cut."""
        return self.ended.outcome if self.ended else None

    @property
    def succeeded(self) -> bool | None:
        """Whether the robot declared arrival, as far as known; None for an unfinished or cancelled query."""
        if self.outcome in (None, Outcome.CANCELLED):
            return None
        return self.outcome is Outcome.ARRIVED and (self.judged is None or self.judged.reached)
