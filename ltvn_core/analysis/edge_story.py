"""The story of one edge: one walk over its changes gives a row for each step of its life.

History, belief, presence and removal are filters of these rows. Makes no text (see `analysis.edge_explanation`) and no
drawing.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import AttemptRecord, Instant, MapChange
from ltvn_core.graph import deltas as d
from ltvn_core.graph.presence.presence_filter import PresenceObservation
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.types import NodeId


class EdgeRow(NamedTuple):
    """One step in the life of an edge: it was added, removed, or seen open or blocked, or its belief changed."""

    instant: Instant
    cause: d.Cause
    before: d.Edge | None
    """The edge before this step; None if it was not in the map."""
    after: d.Edge | None
    """The edge after this step; None if it is not in the map any more."""
    query: int | None = None
    attempt: int | None = None
    """The attempt that led to this step; None if none did."""
    seen: PresenceObservation | None = None
    """The observation that the edge is open or blocked; None for a change of the map."""
    node: NodeId | None = None
    """The node whose removal also removed the edge."""
    whole_map: bool = False
    """Whether the edge was removed because another map replaced its map."""

    @property
    def is_addition(self) -> bool:
        """Whether the edge was added to the map."""
        return self.before is None and self.after is not None

    @property
    def is_removal(self) -> bool:
        """Whether the edge was removed from the map."""
        return self.before is not None and self.after is None

    @property
    def is_update(self) -> bool:
        """Whether the belief of the edge changed."""
        return self.before is not None and self.after is not None and self.seen is None


@dataclass(frozen=True, slots=True)
class EdgeStory:
    """All that happened to one edge; without any row that adds it, the edge never was in the map."""

    source: NodeId
    target: NodeId
    rows: tuple[EdgeRow, ...]
    """All steps, oldest first."""
    attempts: tuple[AttemptRecord, ...]
    """Attempts along the edge, also those that continued past its end; without its verdict while one is under way."""
    planned_at: tuple[Instant, ...]
    """Instants of the plans through the edge."""

    @property
    def edge(self) -> EdgeKey:
        """Source and target."""
        return self.source, self.target

    @property
    def life(self) -> tuple[EdgeRow, ...]:
        """The rows from the last addition on; an edge that is added again has another life."""
        added = [number for number, row in enumerate(self.rows) if row.is_addition]
        return self.rows[added[-1] :] if added else ()

    @property
    def end(self) -> EdgeRow | None:
        """The last removal; None while the edge is in the map, or if it never was."""
        return next((row for row in self.life if row.is_removal), None)

    @property
    def alive(self) -> bool:
        """Whether the edge is in the map at the given instant, or at the end of the timeline."""
        return bool(self.life) and self.end is None

    @property
    def last(self) -> d.Edge | None:
        """The edge as it is, or was when it left the map; None if it never was in the map."""
        return next((edge for row in reversed(self.life) if (edge := row.after or row.before) is not None), None)

    @property
    def beliefs(self) -> tuple[tuple[Instant, d.Edge], ...]:
        """The edge after each addition and change of its belief, and the instant from which that was valid."""
        return tuple((row.instant, row.after) for row in self.rows if row.after is not None and row.seen is None)

    @property
    def counted(self) -> Mapping[tuple[int | None, int | None], EdgeRow]:
        """The change of belief by each attempt that counted, by query and attempt; the second failure of a query does
        not count."""
        return {(row.query, row.attempt): row for row in self.rows if row.is_update and row.attempt is not None}

    @property
    def looks(self) -> tuple[EdgeRow, ...]:
        """The rows in which the edge was seen open or blocked."""
        return tuple(row for row in self.rows if row.seen is not None)


def edge_story(timeline: Timeline, source: NodeId, target: NodeId, until: Instant | None = None) -> EdgeStory:
    """Return the story of an edge up to an instant; up to the end of the timeline without one.

    Linear in the plans and in the changes of the edge.
    """
    count = timeline.count_until(until)
    attempts = (each for each in timeline.attempts_of_edge(source, target) if each.event < count)
    return EdgeStory(
        source=source,
        target=target,
        rows=tuple(_rows(timeline, source, target, count)),
        attempts=tuple(_known_at(each, until) for each in attempts),
        planned_at=tuple(
            plan.instant for plan in timeline.plans if plan.event < count and (source, target) in plan.edges
        ),
    )


def _rows(timeline: Timeline, source: NodeId, target: NodeId, count: int) -> Iterator[EdgeRow]:
    """Walk over the changes of an edge and the removals of its nodes before event number `count`.

    A change that does not fit is skipped, as the recording is damaged, or its beginning is missing.
    """
    ends = [*timeline.changes_of_node(source), *timeline.changes_of_node(target)]
    dropped = [change for change in ends if isinstance(change.delta, d.NodeDropped)]
    edge: d.Edge | None = None
    epoch = 0
    for change in sorted([*timeline.changes_of_edge(source, target), *dropped], key=lambda change: change.event):
        if change.event >= count:
            break
        if edge is not None and epoch < change.epoch:
            yield _replaced_map(timeline, epoch, edge)
            edge = None
        epoch = change.epoch
        if (row := _row(change, edge)) is not None:
            yield row
            edge = row.after
    last = timeline.change_count_before(count) - 1
    if edge is not None and epoch < timeline.changes[last].epoch:
        yield _replaced_map(timeline, epoch, edge)


def _row(change: MapChange, edge: d.Edge | None) -> EdgeRow | None:
    """Return the row of a change of the edge as it was before; None if the change does not fit."""
    row = EdgeRow(change.instant, change.delta.cause, edge, edge, change.query, change.attempt)
    match change.delta:
        case d.EdgeAdded(added) if edge is None:
            return row._replace(after=added)
        case d.BeliefUpdated(_, _, belief, attempts, successes) if edge is not None:
            return row._replace(after=replace(edge, belief=belief, attempts=attempts, successes=successes))
        case d.EdgePruned() if edge is not None:
            return row._replace(after=None)
        case d.NodeDropped(node) if edge is not None:
            return row._replace(after=None, node=node, attempt=None)
        case d.PresenceObserved(present=present, stamp=stamp):
            return row._replace(seen=PresenceObservation(present, stamp))
        case _:
            return None


def _replaced_map(timeline: Timeline, epoch: int, edge: d.Edge) -> EdgeRow:
    """Return the removal of an edge of map number `epoch` by the next map."""
    first = timeline.changes[timeline.epochs[epoch + 1]]
    return EdgeRow(first.instant, first.delta.cause, edge, None, whole_map=True)


def _known_at(attempt: AttemptRecord, until: Instant | None) -> AttemptRecord:
    """Return an attempt as known after a step: without its verdict while it was in progress."""
    is_under_way = until is not None and attempt.end is not None and until.step < attempt.end.step
    return replace(attempt, end=None, ended=None) if is_under_way else attempt
