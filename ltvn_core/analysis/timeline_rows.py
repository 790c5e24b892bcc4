"""Puts the events of a run together into queries, plans, attempts and marks, one event after the other.

Owns what is done about events that are cut off or have no beginning. Each event takes constant time.
"""

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from ltvn_core.analysis.timeline_marks import mark_of
from ltvn_core.analysis.timeline_records import AttemptRecord, Instant, Mark, MarkKind, PlanRecord, QueryRecord
from ltvn_core.graph.deltas import Cause
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.navigation.events import (
    AttemptEnded,
    AttemptStarted,
    Collided,
    Event,
    GraphChanged,
    Judged,
    Localised,
    Note,
    Planned,
    QueryEnded,
    QueryStarted,
    StateChanged,
    WorldChanged,
)
from ltvn_core.types import NodeId


@dataclass(slots=True)
class _OpenQuery:
    """A query under way."""

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
    """The rows that may be still open, closed as they stood after some events."""

    queries: tuple[QueryRecord, ...]
    attempts: tuple[AttemptRecord, ...]
    attempts_by_edge: Mapping[EdgeKey, tuple[AttemptRecord, ...]]
    notes: tuple[str, ...]


class TimelineRows:
    """The queries, attempts, plans and marks of the events so far. A row of something still open is not among them."""

    def __init__(self) -> None:
        """Begin with nothing."""
        self.queries: list[QueryRecord] = []
        self.attempts: list[AttemptRecord] = []
        self.plans: list[PlanRecord] = []
        self.marks: dict[MarkKind | None, list[Mark]] = {None: []}
        """By kind, and all of them under None."""
        self.notes: list[str] = []
        """What is wrong with the events, in words."""
        self.attempts_by_edge: dict[EdgeKey, tuple[AttemptRecord, ...]] = {}
        self._epoch = 0
        self._query: _OpenQuery | None = None
        self._attempt: AttemptRecord | None = None
        self._planned_nodes: tuple[NodeId, ...] | None = None

    def copy(self) -> "TimelineRows":
        """Return one that stays as it is when this one goes on; linear in the rows."""
        twin = self._copy_unclosed()
        twin.plans = list(self.plans)
        twin.marks = {kind: list(marks) for kind, marks in self.marks.items()}
        return twin

    def closed(self, count: int) -> ClosedRows:
        """Return the rows after `count` events, those too of a query and an attempt under way; linear in them."""
        twin = self._copy_unclosed()
        if twin._query is not None:
            twin.notes.append(f"Query {twin._query.started.query} is cut: the events end before it does.")
        twin._close_query(count - 1)
        return ClosedRows(
            queries=tuple(twin.queries),
            attempts=tuple(twin.attempts),
            attempts_by_edge=twin.attempts_by_edge,
            notes=tuple(twin.notes),
        )

    def take(self, index: int, instant: Instant, event: Event) -> None:
        """Take in the next event, which is number `index`."""
        mark = mark_of(index, instant, event, self._planned_nodes)
        if mark is not None:
            self._add_mark(mark)
        if isinstance(event, GraphChanged):
            return  # By far the most events; no row begins or ends with one.
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
            case Localised() | Collided() | StateChanged() | Note() | WorldChanged():
                pass  # No row begins or ends with it.

    def begin_map(self, index: int, instant: Instant, cause: Cause, epoch: int) -> None:
        """Let map number `epoch` begin with event number `index`."""
        self._epoch = epoch
        text = f"map {epoch + 1} comes in ({cause.value})"
        self._add_mark(Mark(kind=MarkKind.MAP, instant=instant, event=index, ids=(), text=text))

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
