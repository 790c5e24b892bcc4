"""The one pass over the events that everything else in the analysis looks things up in.

Owns how events are put together into queries, plans, attempts and changes, and what is done about a list that is cut or
in disorder. Each step of the pass takes constant time.
"""

from copy import copy
from dataclasses import dataclass, field, replace

from ltvn_core.analysis.map_epochs import MapEpochs
from ltvn_core.analysis.map_replay import MapReplayCache
from ltvn_core.analysis.timeline_marks import mark_of
from ltvn_core.analysis.timeline_records import (
    AttemptRecord,
    Instant,
    MapChange,
    Mark,
    MarkKind,
    PlanRecord,
    QueryRecord,
)
from ltvn_core.graph.deltas import BeliefUpdated, EdgeAdded, EdgePruned, NodeAdded, NodeDropped
from ltvn_core.graph.topological_graph import EdgeKey
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
    StampedEvent,
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


class TimelineBuilder:
    """What the pass has put together so far."""

    def __init__(self) -> None:
        """Begin with nothing."""
        self.queries: list[QueryRecord] = []
        self.attempts: list[AttemptRecord] = []
        self.plans: list[PlanRecord] = []
        self.changes: list[MapChange] = []
        self.changes_by_edge: dict[EdgeKey, list[MapChange]] = {}
        self.changes_by_node: dict[NodeId, list[MapChange]] = {}
        self.marks: list[Mark] = []
        self.epochs: list[int] = []
        """Where in `changes` each map begins."""
        self.notes: list[str] = []
        """What was wrong with the list, in words."""
        self.replay_cache = MapReplayCache()
        """Maps folded before."""
        self._epochs = MapEpochs()
        self._query: _OpenQuery | None = None
        self._attempt: AttemptRecord | None = None

    def take(self, index: int, stamped: StampedEvent) -> None:
        """Take in the next event, which is number `index`."""
        event, instant = stamped.event, Instant(int(stamped.step), float(stamped.stamp))
        last_plan = self._query.plans[-1].planned.nodes if self._query and self._query.plans else None
        mark = mark_of(index, instant, event, last_plan)
        if mark is not None:
            self.marks.append(mark)
        match event:
            case GraphChanged():
                self._changed(index, instant, event)
            case QueryStarted():
                self._close_query(index - 1)
                self._query = _OpenQuery(event, self._epochs.current, index, instant)
            case QueryEnded():
                self._ended(index, instant, event)
            case Judged():
                self._judged(instant, event)
            case _:
                self._in_query(index, instant, event)

    def closed_copy(self, count: int) -> "TimelineBuilder":
        """Return a copy in which everything that is still open after `count` events is closed.

        It shares `replay_cache` and what is filed by edge and node with this one, and takes no time worth mentioning.
        """
        twin = copy(self)
        for name in ("queries", "attempts", "plans", "changes", "marks", "epochs", "notes"):
            setattr(twin, name, list(getattr(self, name)))
        if self._query is not None:
            twin._query = replace(self._query, attempts=[*self._query.attempts], plans=[*self._query.plans])
        twin._finish(count)
        return twin

    def _finish(self, count: int) -> None:
        if self._query is not None:
            self.notes.append(f"Query {self._query.started.query} is cut: the events end before it does.")
        self._close_query(count - 1)

    def _in_query(self, index: int, instant: Instant, event: Event) -> None:
        match event:
            case Localised() if self._query is not None:
                self._query.localised = event
            case Planned():
                self._planned(index, instant, event)
            case AttemptStarted():
                self._close_attempt()
                plan = self._query.plans[-1] if self._query and self._query.plans else None
                self._attempt = AttemptRecord(index, instant, event, plan, None, None, 0)
            case Collided() if self._attempt is not None:
                self._attempt = replace(self._attempt, collisions=self._attempt.collisions + 1)
            case AttemptEnded():
                self._attempt_ended(instant, event)
            case _:
                return

    def _changed(self, index: int, instant: Instant, event: GraphChanged) -> None:
        fresh = self._epochs.take(event.delta)
        if fresh or not self.epochs:
            self.epochs.append(len(self.changes))
        if fresh:
            text = f"map {self._epochs.current + 1} comes in ({event.delta.cause.value})"
            self.marks.append(Mark(MarkKind.MAP, instant, index, (), text))
        moment = index, instant, self._epochs.current, self._epochs.version
        self._file(MapChange(*moment, event.delta, event.query, event.attempt))

    def _file(self, change: MapChange) -> None:
        self.changes.append(change)
        match change.delta:
            case EdgeAdded(edge=edge):
                self.changes_by_edge.setdefault((edge.source, edge.target), []).append(change)
            case BeliefUpdated(source=source, target=target) | EdgePruned(source=source, target=target):
                self.changes_by_edge.setdefault((source, target), []).append(change)
            case NodeAdded(node=node):
                self.changes_by_node.setdefault(node.id, []).append(change)
            case NodeDropped(node=node):
                self.changes_by_node.setdefault(node, []).append(change)

    def _planned(self, index: int, instant: Instant, event: Planned) -> None:
        plan = PlanRecord(index, instant, event, self._query.localised if self._query else None)
        self.plans.append(plan)
        if self._query is not None:
            self._query.plans.append(plan)

    def _attempt_ended(self, instant: Instant, event: AttemptEnded) -> None:
        attempt = self._attempt
        if attempt is None or (attempt.started.attempt, attempt.started.query) != (event.attempt, event.query):
            self.notes.append(f"Attempt {event.attempt} ends in step {instant.step} without its start; it is left out.")
            return
        self._attempt = replace(attempt, end=instant, ended=event)
        self._close_attempt()

    def _close_attempt(self) -> None:
        if self._attempt is None:
            return
        self.attempts.append(self._attempt)
        if self._query is not None:
            self._query.attempts.append(self._attempt)
        self._attempt = None

    def _ended(self, index: int, instant: Instant, event: QueryEnded) -> None:
        if self._query is None or self._query.started.query != event.query:
            self.notes.append(f"Query {event.query} ends in step {instant.step} without its start; it is left out.")
            return
        self._close_query(index, instant, event)

    def _close_query(self, last: int, end: Instant | None = None, ended: QueryEnded | None = None) -> None:
        self._close_attempt()
        if (query := self._query) is None:
            return
        rows = tuple(query.attempts), tuple(query.plans)
        span = query.epoch, query.first, last, query.begin, end
        self.queries.append(QueryRecord(query.started.query, query.started.goal, *span, ended, None, *rows))
        self._query = None

    def _judged(self, instant: Instant, event: Judged) -> None:
        if self._query is None and self.queries and self.queries[-1].id == event.query:
            self.queries[-1] = replace(self.queries[-1], judged=event)
        else:
            self.notes.append(f"The verdict on query {event.query} in step {instant.step} has no query; left out.")
