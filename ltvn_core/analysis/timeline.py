"""The run as a whole: one pass over its events, and where in it to find things.

Owns order and look-up; what the rows hold is `analysis.records`, how they are put together `analysis.indexing`. Works
the same on a recording's events and on those of a run that is still going on.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Self

from ltvn_core.analysis.map_replay import MapReplayCache
from ltvn_core.analysis.timeline_builder import TimelineBuilder
from ltvn_core.analysis.timeline_records import (
    AttemptRecord,
    Instant,
    MapChange,
    Mark,
    MarkKind,
    PlanRecord,
    QueryRecord,
)
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.navigation.events import StampedEvent
from ltvn_core.types import FrameId, NodeId

__all__ = ["AttemptRecord", "Instant", "MapChange", "Mark", "MarkKind", "PlanRecord", "QueryRecord", "Timeline"]


@dataclass(frozen=True, eq=False)
class Timeline:
    """A run, indexed. Positions called `event` are indices of `events`; a cursor is the step of an `Instant`."""

    events: Sequence[StampedEvent]
    """In order of their steps."""
    queries: tuple[QueryRecord, ...]
    attempts: tuple[AttemptRecord, ...]
    """All legs, those outside a query too."""
    plans: tuple[PlanRecord, ...]
    changes: tuple[MapChange, ...]
    marks: tuple[Mark, ...]
    epochs: tuple[int, ...]
    """Where in `changes` each map of the recording begins."""
    notes: tuple[str, ...]
    """What is wrong with the events, for a person to read; empty if all is well."""
    _by_edge: Mapping[EdgeKey, Sequence[MapChange]] = field(repr=False)
    """Goes on beyond this timeline where the run does, like the next."""
    _by_node: Mapping[NodeId, Sequence[MapChange]] = field(repr=False)
    _replay_cache: MapReplayCache = field(repr=False)

    @classmethod
    def of(cls, events: Iterable[StampedEvent]) -> Self:
        """Index events; linear in them.

        Events in disorder are put in order by their steps, those of one step as they stand. Never raises for events
        that are cut, incomplete or in disorder: `notes` tells.
        """
        ordered = list(events)
        late = sum(after.step < before.step for before, after in pairwise(ordered))
        if late:
            ordered.sort(key=lambda stamped: stamped.step)
        index = TimelineBuilder()
        for number, stamped in enumerate(ordered):
            index.take(number, stamped)
        disorder = (f"{late} events come after a later one; all are put in order by their steps.",) if late else ()
        return cls.built(index, ordered, disorder)

    @classmethod
    def built(cls, index: TimelineBuilder, events: Sequence[StampedEvent], notes: tuple[str, ...] = ()) -> Self:
        """Return the timeline of `events`, all of which `index` has taken; the index may go on taking more."""
        built = index.closed_copy(len(events))
        return cls(
            events=events,
            queries=tuple(built.queries),
            attempts=tuple(built.attempts),
            plans=tuple(built.plans),
            changes=tuple(built.changes),
            marks=tuple(built.marks),
            epochs=tuple(built.epochs),
            notes=(*notes, *built.notes),
            _by_edge=built.changes_by_edge,
            _by_node=built.changes_by_node,
            _replay_cache=built.replay_cache,
        )

    @cached_property
    def _marks_of(self) -> Mapping[MarkKind | None, list[Mark]]:
        """The marks by kind, and all of them under None."""
        found: dict[MarkKind | None, list[Mark]] = {None: list(self.marks)}
        for mark in self.marks:
            found.setdefault(mark.kind, []).append(mark)
        return found

    def instant(self, event: int) -> Instant:
        """Return the moment of event number `event`."""
        return Instant(int(self.events[event].step), float(self.events[event].stamp))

    def count_until(self, instant: Instant | None) -> int:
        """Return how many events happened up to and in a step; all without an instant. Logarithmic."""
        return len(self.events) if instant is None else bisect_right(self.events, instant.step, key=_step)

    def changes_until(self, instant: Instant | None = None) -> tuple[MapChange, ...]:
        """Return the changes of all maps up to and in a step."""
        return self.changes_before(self.count_until(instant))

    def changes_before(self, event: int) -> tuple[MapChange, ...]:
        """Return the changes of all maps before event number `event`."""
        return self.changes[: bisect_left(self.changes, event, key=_number)]

    def graph_at(self, instant: Instant | None = None) -> TopologicalGraph:
        """Return the map after everything up to and in a step, at the end without one; it may be changed freely.

        Linear in the changes before it at first, later a copy and at most some thousands of changes.
        """
        return self.graph_before(self.count_until(instant))

    def graph_before(self, event: int) -> TopologicalGraph:
        """Return the map as it was just before event number `event`; costs as much as `graph_at`."""
        return self._replay_cache.after(self.changes, bisect_left(self.changes, event, key=_number))

    def query_at(self, event: int) -> QueryRecord | None:
        """Return the query that event number `event` belongs to. Logarithmic."""
        place = bisect_right(self.queries, event, key=lambda query: query.first) - 1
        return self.queries[place] if place >= 0 and event <= self.queries[place].last else None

    def next_event(self, at: Instant) -> Instant | None:
        """Return the next moment at which anything happens; None at the end. Logarithmic."""
        place = bisect_right(self.events, at.step, key=_step)
        return self.instant(place) if place < len(self.events) else None

    def previous_event(self, at: Instant) -> Instant | None:
        """Return the last moment before at which anything happened; None at the beginning. Logarithmic."""
        place = bisect_left(self.events, at.step, key=_step) - 1
        return self.instant(place) if place >= 0 else None

    def marks_until(self, instant: Instant | None = None, kind: MarkKind | None = None) -> list[Mark]:
        """Return the marks up to and in a step, of one kind if that is given; all without an instant."""
        marks = self._marks_of.get(kind, [])
        return marks if instant is None else marks[: bisect_right(marks, instant.step, key=_step_of_mark)]

    def next_mark(self, at: Instant, kind: MarkKind | None = None) -> Mark | None:
        """Return the first mark in a later step, of one kind if that is given. Logarithmic."""
        marks = self._marks_of.get(kind, [])
        place = bisect_right(marks, at.step, key=_step_of_mark)
        return marks[place] if place < len(marks) else None

    def previous_mark(self, at: Instant, kind: MarkKind | None = None) -> Mark | None:
        """Return the last mark in an earlier step, of one kind if that is given. Logarithmic."""
        marks = self._marks_of.get(kind, [])
        place = bisect_left(marks, at.step, key=_step_of_mark) - 1
        return marks[place] if place >= 0 else None

    def next_query(self, at: Instant) -> QueryRecord | None:
        """Return the first query that begins in a later step. Logarithmic."""
        place = bisect_right(self.queries, at.step, key=lambda query: query.begin.step)
        return self.queries[place] if place < len(self.queries) else None

    def previous_query(self, at: Instant) -> QueryRecord | None:
        """Return the last query that began in an earlier step. Logarithmic."""
        place = bisect_left(self.queries, at.step, key=lambda query: query.begin.step) - 1
        return self.queries[place] if place >= 0 else None

    def changes_of_edge(self, source: NodeId, target: NodeId) -> tuple[MapChange, ...]:
        """Return all changes of an edge in order; none for an edge that never was; linear in them."""
        return self._known(self._by_edge.get((source, target), ()))

    def changes_of_node(self, node: NodeId) -> tuple[MapChange, ...]:
        """Return all arrivals and departures of a node in order; linear in them."""
        return self._known(self._by_node.get(node, ()))

    def attempts_of_edge(self, source: NodeId, target: NodeId) -> tuple[AttemptRecord, ...]:
        """Return all legs along an edge in order, those too that drove past its end.

        Once per timeline linear in the attempts.
        """
        return tuple(self._attempts_by_edge.get((source, target), ()))

    def _known(self, changes: Sequence[MapChange]) -> tuple[MapChange, ...]:
        """Leave out what happened after the last event of this timeline."""
        return tuple(changes[: bisect_left(changes, len(self.events), key=_number)])

    @cached_property
    def _attempts_by_edge(self) -> Mapping[EdgeKey, list[AttemptRecord]]:
        found: dict[EdgeKey, list[AttemptRecord]] = {}
        for attempt in self.attempts:
            for edge in attempt.edges:
                found.setdefault(edge, []).append(attempt)
        return found


def _step(stamped: StampedEvent) -> FrameId:
    return stamped.step


def _number(change: MapChange) -> int:
    return change.event


def _step_of_mark(mark: Mark) -> FrameId:
    return mark.instant.step
