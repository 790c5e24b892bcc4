"""Collects the events of a run into queries, plans, attempts and marks, one event after the other.

Owns the treatment of events that are cut off or have no beginning, and the choice of marks at which stepping through
the run stops. `navigation.event_table` says which events get a mark. Each event takes constant time, a plan and an
attempt those of their query.
"""

from collections.abc import Mapping
from copy import copy
from dataclasses import replace
from typing import NamedTuple

from ltvn_core.analysis.timeline_records import AttemptRecord, Instant, Mark, PlanRecord, QueryRecord
from ltvn_core.graph.deltas import Cause
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.navigation.event_table import EventDescription, MarkKind, NavigationProgress
from ltvn_core.navigation.events import (
    AttemptEnded,
    AttemptStarted,
    Event,
    GraphChanged,
    Judged,
    Planned,
    QueryEnded,
    QueryStarted,
)

STOPS = (
    MarkKind.MAP,
    MarkKind.QUERY_START,
    MarkKind.QUERY_END,
    MarkKind.PRUNE,
    MarkKind.EXPAND,
    MarkKind.COLLISION,
    MarkKind.FAILURE,
    MarkKind.REPLAN,
)
"""Kinds of marks at which stepping through the run stops. The others are too frequent, or are not actions of the
robot."""


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
        """Marks of all events by kind; None holds the marks of all kinds."""
        self.notes: list[str] = []
        """Defects of the events, as sentences."""
        self.attempts_by_edge: dict[EdgeKey, tuple[AttemptRecord, ...]] = {}
        self._epoch = 0
        """Number of the map in which the next query starts."""
        self._query: QueryRecord | None = None
        """The query in progress, as far as it is known."""
        self._attempt: AttemptRecord | None = None

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
            twin.notes.append(f"Query {twin._query.id} is cut off: its events end before it does.")
        twin._close_query(count - 1)
        return ClosedRows(
            queries=tuple(twin.queries),
            attempts=tuple(twin.attempts),
            attempts_by_edge=twin.attempts_by_edge,
            notes=tuple(twin.notes),
        )

    def take(
        self, index: int, instant: Instant, event: Event, before: NavigationProgress, row: EventDescription
    ) -> None:
        """Process the next event, number `index`, with its row; `before` is the progress before it."""
        if row.mark is not None and row.mark in STOPS:
            self._add_mark(Mark(kind=row.mark, instant=instant, event=index, ids=row.about, happened=event))
        match event:
            case GraphChanged():
                return  # This is by far the most frequent event; no row begins or ends with it.
            case QueryStarted():
                self._query_started(index, instant, event)
            case QueryEnded():
                self._query_ended(index, instant, event)
            case Judged():
                self._judged(instant, event)
            case Planned():
                self._planned(index, instant, event, before)
            case AttemptStarted():
                self._attempt_started(index, instant, event)
            case AttemptEnded():
                self._attempt_ended(instant, event)
            case _:
                pass  # No row begins or ends with it.

    def begin_map(self, index: int, instant: Instant, cause: Cause, epoch: int) -> None:
        """Begin map number `epoch` with event number `index`."""
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
        return twin

    def _planned(self, index: int, instant: Instant, event: Planned, before: NavigationProgress) -> None:
        localised = before.localised if self._query is not None else None
        self.plans.append(PlanRecord(index, instant, event, localised, previous=before.last_plan))
        if self._query is not None:
            self._query = replace(self._query, plans=(*self._query.plans, self.plans[-1]))

    def _attempt_started(self, index: int, instant: Instant, event: AttemptStarted) -> None:
        self._close_attempt()
        self._attempt = AttemptRecord(
            event=index,
            begin=instant,
            started=event,
            plan=self._query.plans[-1] if self._query is not None and self._query.plans else None,
            end=None,
            ended=None,
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
            self._query = replace(self._query, attempts=(*self._query.attempts, attempt))
        self._attempt = None

    def _query_started(self, index: int, instant: Instant, event: QueryStarted) -> None:
        self._close_query(index - 1)
        self._query = QueryRecord(
            id=event.query,
            goal=event.goal,
            epoch=self._epoch,
            first=index,
            last=index,
            begin=instant,
            end=None,
            ended=None,
            judged=None,
            attempts=(),
            plans=(),
        )

    def _query_ended(self, index: int, instant: Instant, event: QueryEnded) -> None:
        if self._query is None or self._query.id != event.query:
            self.notes.append(f"Query {event.query} ends in step {instant.step} without its start; it is left out.")
            return
        self._close_query(index, instant, event)

    def _close_query(self, last: int, end: Instant | None = None, ended: QueryEnded | None = None) -> None:
        self._close_attempt()
        if self._query is not None:
            self.queries.append(replace(self._query, last=last, end=end, ended=ended))
            self._query = None

    def _judged(self, instant: Instant, event: Judged) -> None:
        if self._query is None and self.queries and self.queries[-1].id == event.query:
            self.queries[-1] = replace(self.queries[-1], judged=event)
        else:
            self.notes.append(f"The verdict on query {event.query} in step {instant.step} has no query; left out.")
