"""Collects the events of a run into queries, plans, attempts and marks, one event after the other.

Owns the treatment of events that are cut off or have no beginning, the choice of events that get a mark, and the choice
of marks at which stepping through the run stops. `navigation.event_text` makes the text of a mark, and the page its
look. Each event takes constant time.
"""

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from ltvn_core.analysis.timeline_records import AttemptRecord, Instant, Mark, MarkKind, PlanRecord, QueryRecord
from ltvn_core.graph import deltas as d
from ltvn_core.graph.deltas import Cause
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.navigation import events as e
from ltvn_core.navigation.events import (
    AttemptEnded,
    AttemptStarted,
    Collided,
    Event,
    GraphChanged,
    Judged,
    Localised,
    Planned,
    QueryEnded,
    QueryStarted,
)
from ltvn_core.types import NodeId
from ltvn_core.worlds import DoorMoved, PersonLeft, PersonMoved

_EXPANSION_CAUSES = (d.Cause.EXPAND, d.Cause.NOVEL)
_STOPS = frozenset(MarkKind) - {
    MarkKind.ADD,
    MarkKind.SEEN_OPEN,
    MarkKind.SEEN_BLOCKED,
    MarkKind.DOOR_OPENED,
    MarkKind.DOOR_CLOSED,
    MarkKind.WORLD,
}
"""Kinds of marks at which stepping through the run stops. The others are too frequent, or are not actions of the
robot."""


class EventMark(NamedTuple):
    """Kind and subject of the mark of an event."""

    kind: MarkKind
    about: tuple[int, ...] = ()
    """The nodes, the two nodes of an edge, or the number of a door."""


def mark_of(index: int, instant: Instant, event: e.Event, last_plan: tuple[NodeId, ...] | None) -> Mark | None:
    """Return the mark of an event if stepping through the run stops there, otherwise None; see `event_mark`."""
    found = event_mark(event, last_plan)
    if found is None or found.kind not in _STOPS:
        return None
    return Mark(kind=found.kind, instant=instant, event=index, ids=found.about, happened=event)


def _is_other_plan(nodes: tuple[NodeId, ...], last_plan: tuple[NodeId, ...]) -> bool:
    """Tell whether a path differs from the rest of the previous path; no path also counts as different."""
    is_rest = nodes == last_plan[len(last_plan) - len(nodes) :] if 0 < len(nodes) <= len(last_plan) else False
    return not is_rest and nodes != last_plan


def event_mark(event: e.Event, last_plan: tuple[NodeId, ...] | None) -> EventMark | None:
    """Return the mark of an event, None if it gets none; `last_plan` is the previous path of this query."""
    match event:
        case e.QueryStarted(goal=goal):
            return EventMark(MarkKind.QUERY_START, (goal,))
        case e.QueryEnded(goal=goal):
            return EventMark(MarkKind.QUERY_END, (goal,))
        case e.Collided():
            return EventMark(MarkKind.COLLISION)
        case e.AttemptEnded(source=source, target=target, succeeded=False, end=end) if (
            end is not e.AttemptEnd.CANCELLED
        ):
            return EventMark(MarkKind.FAILURE, (target,) if source is None else (source, target))
        case e.ActionEnded(source=source, target=target, succeeded=False):
            return EventMark(MarkKind.FAILURE, (source, target))
        case e.Planned(nodes=nodes) if last_plan is not None and _is_other_plan(nodes, last_plan):
            return EventMark(MarkKind.REPLAN, (*nodes[:1], *nodes[-1:]))
        case e.GraphChanged(delta=delta):
            return None if delta.cause in d.BULK_CAUSES else _mark_of_change(delta)
        case e.WorldChanged(change=DoorMoved(door=door, is_open=is_open)):
            return EventMark(MarkKind.DOOR_OPENED if is_open else MarkKind.DOOR_CLOSED, (door,))
        case e.WorldChanged(change=change):
            return None if isinstance(change, PersonMoved | PersonLeft) else EventMark(MarkKind.WORLD)
        case _:
            return None


def _mark_of_change(delta: d.GraphDelta) -> EventMark | None:
    match delta:
        case d.EdgePruned(source=source, target=target):
            return EventMark(MarkKind.PRUNE, (source, target))
        case d.NodeDropped(node=node):
            return EventMark(MarkKind.PRUNE, (node,))
        case d.NodeAdded(node=node, cause=cause):
            return EventMark(MarkKind.EXPAND if cause in _EXPANSION_CAUSES else MarkKind.ADD, (node.id,))
        case d.EdgeAdded(edge=edge):
            return EventMark(MarkKind.ADD, (edge.source, edge.target))
        case d.PresenceObserved(source=source, target=target, present=present):
            return EventMark(MarkKind.SEEN_OPEN if present else MarkKind.SEEN_BLOCKED, (source, target))
        case _:
            return None


@dataclass(slots=True)
class _OpenQuery:
    """A query in progress."""

    started: QueryStarted
    epoch: int
    first: int
    begin: Instant
    attempts: list[AttemptRecord] = field(default_factory=list)
    plans: list[PlanRecord] = field(default_factory=list)
    localised: Localised | None = None

    @property
    def plan(self) -> PlanRecord | None:
        """The latest plan."""
        return self.plans[-1] if self.plans else None


class ClosedRows(NamedTuple):
    """All rows after some events, including those still open at that moment."""

    queries: tuple[QueryRecord, ...]
    attempts: tuple[AttemptRecord, ...]
    attempts_by_edge: Mapping[EdgeKey, tuple[AttemptRecord, ...]]
    notes: tuple[str, ...]


class TimelineRows:
    """The queries, attempts, plans and marks of the events so far. Open queries and attempts are not included."""

    def __init__(self) -> None:
        """Start without events."""
        self.queries: list[QueryRecord] = []
        self.attempts: list[AttemptRecord] = []
        self.plans: list[PlanRecord] = []
        self.marks: dict[MarkKind | None, list[Mark]] = {None: []}
        """Marks by kind; None holds the marks of all kinds."""
        self.notes: list[str] = []
        """Defects of the events, as sentences."""
        self.attempts_by_edge: dict[EdgeKey, tuple[AttemptRecord, ...]] = {}
        self._epoch = 0
        self._query: _OpenQuery | None = None
        self._attempt: AttemptRecord | None = None
        self._planned_nodes: tuple[NodeId, ...] | None = None

    def copy(self) -> "TimelineRows":
        """Return a copy that does not change when this one grows; linear in the rows."""
        twin = self._copy_unclosed()
        twin.plans = list(self.plans)
        twin.marks = {kind: list(marks) for kind, marks in self.marks.items()}
        return twin

    def closed(self, count: int) -> ClosedRows:
        """Return the rows after `count` events, including those of a query and an attempt in progress; linear in
        them."""
        twin = self._copy_unclosed()
        if twin._query is not None:
            twin.notes.append(f"Query {twin._query.started.query} is cut off: its events end before it does.")
        twin._close_query(count - 1)
        return ClosedRows(
            queries=tuple(twin.queries),
            attempts=tuple(twin.attempts),
            attempts_by_edge=twin.attempts_by_edge,
            notes=tuple(twin.notes),
        )

    def take(self, index: int, instant: Instant, event: Event) -> None:
        """Process the next event, which is number `index`."""
        mark = mark_of(index, instant, event, self._planned_nodes)
        if mark is not None:
            self._add_mark(mark)
        if isinstance(event, GraphChanged):
            return  # This is by far the most frequent event; no row begins or ends with it.
        match event:
            case QueryStarted():
                self._close_query(index - 1)
                self._query = _OpenQuery(started=event, epoch=self._epoch, first=index, begin=instant)
                self._planned_nodes = None
            case QueryEnded():
                self._query_ended(index, instant, event)
            case Judged():
                self._judged(instant, event)
            case Localised() if self._query is not None:
                self._query.localised = event
            case Planned():
                self._planned(index, instant, event)
            case AttemptStarted():
                self._attempt_started(index, instant, event)
            case Collided() if self._attempt is not None:
                self._attempt = replace(self._attempt, collisions=self._attempt.collisions + 1)
            case AttemptEnded():
                self._attempt_ended(instant, event)
            case _:
                pass  # No row begins or ends with it.

    def begin_map(self, index: int, instant: Instant, cause: Cause, epoch: int) -> None:
        """Note that map number `epoch` begins with event number `index`."""
        self._epoch = epoch
        text = f"map {epoch + 1} is loaded ({cause.value})"
        self._add_mark(Mark(kind=MarkKind.MAP, instant=instant, event=index, ids=(), happened=text))

    def _add_mark(self, mark: Mark) -> None:
        self.marks[None].append(mark)
        self.marks.setdefault(mark.kind, []).append(mark)

    def _copy_unclosed(self) -> "TimelineRows":
        twin = copy(self)
        twin.queries = list(self.queries)
        twin.attempts = list(self.attempts)
        twin.notes = list(self.notes)
        twin.attempts_by_edge = dict(self.attempts_by_edge)
        if self._query is not None:
            twin._query = replace(self._query, attempts=[*self._query.attempts], plans=[*self._query.plans])
        return twin

    def _planned(self, index: int, instant: Instant, event: Planned) -> None:
        localised = self._query.localised if self._query is not None else None
        plan = PlanRecord(
            event=index, instant=instant, planned=event, localised=localised, previous=self._planned_nodes
        )
        self._planned_nodes = event.nodes
        self.plans.append(plan)
        if self._query is not None:
            self._query.plans.append(plan)

    def _attempt_started(self, index: int, instant: Instant, event: AttemptStarted) -> None:
        self._close_attempt()
        self._attempt = AttemptRecord(
            event=index,
            begin=instant,
            started=event,
            plan=self._query.plan if self._query is not None else None,
            end=None,
            ended=None,
            collisions=0,
        )

    def _attempt_ended(self, instant: Instant, event: AttemptEnded) -> None:
        attempt = self._attempt
        if attempt is None or (attempt.started.attempt, attempt.started.query) != (event.attempt, event.query):
            self.notes.append(f"Attempt {event.attempt} ends in step {instant.step} without its start; it is left out.")
            return
        self._attempt = replace(attempt, end=instant, ended=event)
        self._close_attempt()

    def _close_attempt(self) -> None:
        if (attempt := self._attempt) is None:
            return
        self.attempts.append(attempt)
        for edge in attempt.edges:
            self.attempts_by_edge[edge] = (*self.attempts_by_edge.get(edge, ()), attempt)
        if self._query is not None:
            self._query.attempts.append(attempt)
        self._attempt = None

    def _query_ended(self, index: int, instant: Instant, event: QueryEnded) -> None:
        if self._query is None or self._query.started.query != event.query:
            self.notes.append(f"Query {event.query} ends in step {instant.step} without its start; it is left out.")
            return
        self._close_query(index, instant, event)

    def _close_query(self, last: int, end: Instant | None = None, ended: QueryEnded | None = None) -> None:
        self._close_attempt()
        if (query := self._query) is None:
            return
        self.queries.append(
            QueryRecord(
                id=query.started.query,
                goal=query.started.goal,
                epoch=query.epoch,
                first=query.first,
                last=last,
                begin=query.begin,
                end=end,
                ended=ended,
                judged=None,
                attempts=tuple(query.attempts),
                plans=tuple(query.plans),
            )
        )
        self._query = None

    def _judged(self, instant: Instant, event: Judged) -> None:
        if self._query is None and self.queries and self.queries[-1].id == event.query:
            self.queries[-1] = replace(self.queries[-1], judged=event)
        else:
            self.notes.append(f"The verdict on query {event.query} in step {instant.step} has no query; left out.")
