"""One run as a timeline: its images and events in order, and the state at any moment.

Owns order, time and look-up. The timeline grows during a live run, and is filled at once from a recording; the page and
the analysis use the same one. `analysis.timeline_records` defines the rows, `analysis.timeline_rows` makes them, and
`analysis.map_history` holds the maps. Holds no images.
"""

import itertools
from bisect import bisect_right
from collections.abc import Callable, Iterable, Sequence
from copy import copy
from operator import attrgetter
from typing import Self, TypeVar

from ltvn_core.analysis.map_history import GraphHistory, MapHistory
from ltvn_core.analysis.recorded_frames import RecordedFrames
from ltvn_core.analysis.timeline_records import (
    AttemptRecord,
    Instant,
    MapChange,
    Mark,
    MarkKind,
    PlanRecord,
    QueryRecord,
)
from ltvn_core.analysis.timeline_rows import ClosedRows, TimelineRows
from ltvn_core.garbage_collection import garbage_collection_paused
from ltvn_core.graph.deltas import Cause, NodeAdded
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.navigation.event_table import NO_PROGRESS, NavigationProgress, describe_event
from ltvn_core.navigation.events import GraphChanged, StampedEvent
from ltvn_core.types import FrameId, NodeId, Pose

_Row = TypeVar("_Row")
_STEP = attrgetter("step")
_STEP_OF_MARK = attrgetter("instant.step")
_SAME_S = 1e-5
"""Greatest difference in seconds between two moments that are the same moment for the page."""


class Timeline:
    """The images and events of one run.

    `event` is always an index of `events`. An `Instant` is a moment of the run, and everything that happened in its
    step is included. Only one thread may use a timeline; another thread needs a `copy`.
    """

    def __init__(self) -> None:
        """Start without images and events."""
        self.frames = RecordedFrames()
        self._clear()

    @classmethod
    def of(cls, events: Iterable[StampedEvent], frames: Iterable[tuple[FrameId, float, Pose]] = ()) -> Self:
        """Return the timeline of a recording, from its events and its images as (step, stamp_s, pose (3,)).

        Never raises for events that are cut, incomplete or out of order; `notes` describes these defects. Images of a
        map that was loaded before the run give the poses of its nodes, but do not count as driven. In a file that holds
        a map alone they do, so that the drive it was built from can be seen, with the map from its first image on.
        Linear in both.
        """
        timeline = cls()
        arrived = list(events)
        loaded = _loaded_until(arrived)
        columns = list(zip(*frames, strict=True))
        if columns and max(columns[0]) <= loaded:
            arrived = [each._replace(step=columns[0][0], stamp=columns[1][0]) for each in arrived]
            loaded = -1
        if columns:
            timeline.frames.extend(*columns, placed_until=loaded)
        with garbage_collection_paused():
            timeline._fold(sorted(arrived, key=_STEP), _late_count(arrived))
        return timeline

    def append_frame(self, step: FrameId, stamp: float, pose: Pose) -> None:
        """Add an image that was taken at `stamp` seconds at `pose` (3,)."""
        self.frames.append(step, stamp, pose)

    def place_frame(self, step: FrameId, pose: Pose) -> None:
        """Set the pose (3,) of an image that was not taken in this run: an image of the map with which it began."""
        self.frames.place(step, pose)

    def append_event(self, stamped: StampedEvent) -> None:
        """Add an event, in constant time.

        An event of an earlier step than the last one is inserted in its place, and all events are processed again. An
        event that has only an earlier stamp gets the latest stamp.
        """
        if self._events and stamped.step < self._events[-1].step:
            self._fold(sorted([*self._events, stamped], key=_STEP), self._late + 1)
        else:
            self._append(stamped)

    def copy(self) -> "Timeline":
        """Return a copy that does not change when this one grows, to be read in another thread; linear in the rows."""
        twin = copy(self)
        twin._events = list(self._events)
        twin._stamps = list(self._stamps)
        twin._progress = list(self._progress)
        twin._maps = self._maps.copy()
        twin._rows = self._rows.copy()
        return twin

    @property
    def events(self) -> Sequence[StampedEvent]:
        """All events in the order of their steps; events of one step are in the order of arrival."""
        return self._events

    @property
    def queries(self) -> tuple[QueryRecord, ...]:
        """All queries, including the one in progress."""
        return self._closed.queries

    @property
    def attempts(self) -> tuple[AttemptRecord, ...]:
        """All attempts, including those outside a query and the one in progress."""
        return self._closed.attempts

    @property
    def plans(self) -> Sequence[PlanRecord]:
        """All plans."""
        return self._rows.plans

    @property
    def marks(self) -> Sequence[Mark]:
        """All marks."""
        return self._rows.marks[None]

    @property
    def changes(self) -> Sequence[MapChange]:
        """All changes of all maps."""
        return self._maps.changes

    @property
    def epochs(self) -> tuple[int, ...]:
        """Index in `changes` at which each map of the recording begins."""
        return tuple(self._maps.epochs)

    @property
    def notes(self) -> tuple[str, ...]:
        """Defects of the events, as sentences; empty if there are none."""
        late = f"{self._late} events were recorded after a later one; all were sorted by their steps."
        return (*([late] if self._late else []), *self._closed.notes)

    @property
    def drawing(self) -> GraphHistory:
        """The maps as arrays for drawing, by the number of changes."""
        return self._maps.drawing

    @property
    def start_s(self) -> float:
        """Time of the first driven image, in seconds on the robot's clock; without images, that of the first event."""
        if len(self.frames):
            return self.frames.stamp(0)
        return self._stamps[0] if self._stamps else 0.0

    @property
    def end_s(self) -> float:
        """The last moment, in seconds on the robot's clock."""
        last_frame = [self.frames.stamp(len(self.frames) - 1)] if len(self.frames) else []
        return max([*last_frame, *self._stamps[-1:]], default=0.0)

    def instant(self, event: int) -> Instant:
        """Return the instant of event number `event`."""
        return Instant(int(self._events[event].step), self._stamps[event])

    def instant_at(self, stamp: float) -> Instant:
        """Return the instant at `stamp` seconds; its step is that of the newest image or event, -1 before the first."""
        frames = self.frames.count_at(stamp)
        events = self.count_at(stamp)
        last_frame = self.frames.step(frames - 1) if frames else -1
        last_event = int(self._events[events - 1].step) if events else -1
        return Instant(max(last_frame, last_event), stamp)

    def count_at(self, stamp: float) -> int:
        """Return the number of events up to `stamp` seconds. Takes logarithmic time."""
        return bisect_right(self._stamps, stamp)

    def count_until(self, instant: Instant | None) -> int:
        """Return the number of events up to the end of a step; all without an instant. Takes logarithmic time."""
        return len(self._events) if instant is None else bisect_right(self._events, instant.step, key=_STEP)

    def progress_before(self, event: int) -> NavigationProgress:
        """Return the state of navigation just before event number `event`."""
        return self._progress[event - 1] if event else NO_PROGRESS

    def graph_at(self, instant: Instant | None = None) -> TopologicalGraph:
        """Return the map at the end of a step, or of the run without an instant; the caller may change it.

        Copies one map and replays some thousands of changes at most.
        """
        return self.graph_before(self.count_until(instant))

    def graph_before(self, event: int) -> TopologicalGraph:
        """Return the map just before event number `event`; costs as much as `graph_at`."""
        return self._maps.graph_after(self.change_count_before(event))

    def change_count_before(self, event: int) -> int:
        """Return the number of changes of all maps before event number `event`. Takes logarithmic time."""
        return self._maps.count_before(event)

    def changes_of_edge(self, source: NodeId, target: NodeId) -> Sequence[MapChange]:
        """Return all changes of an edge in order; empty if the edge was never in the map; linear in them."""
        return self._maps.of_edge((source, target))

    def changes_of_node(self, node: NodeId) -> Sequence[MapChange]:
        """Return all additions and removals of a node in order; linear in them."""
        return self._maps.of_node(node)

    def attempts_of_edge(self, source: NodeId, target: NodeId) -> tuple[AttemptRecord, ...]:
        """Return all attempts along an edge in order, including those that continued past its end."""
        return self._closed.attempts_by_edge.get((source, target), ())

    def query_at(self, event: int) -> QueryRecord | None:
        """Return the query to which event number `event` belongs, None if it belongs to none. Takes logarithmic
        time."""
        queries = self.queries
        place = bisect_right(queries, event, key=lambda query: query.first) - 1
        return queries[place] if place >= 0 and event <= queries[place].last else None

    def marks_until(self, instant: Instant | None = None, kind: MarkKind | None = None) -> Sequence[Mark]:
        """Return the marks up to the end of a step, or all marks without an instant; only those of one kind if `kind`
        is given."""
        marks = self._rows.marks.get(kind, ())
        return marks if instant is None else marks[: bisect_right(marks, instant.step, key=_STEP_OF_MARK)]

    @property
    def _closed(self) -> ClosedRows:
        """The rows, including those of a query and an attempt in progress."""
        known = self._closed_at
        if known is None or known[0] != len(self._events):
            known = self._closed_at = len(self._events), self._rows.closed(len(self._events))
        return known[1]

    def _clear(self) -> None:
        self._events: list[StampedEvent] = []
        self._stamps: list[float] = []
        self._progress: list[NavigationProgress] = []
        self._maps = MapHistory()
        self._rows = TimelineRows()
        self._closed_at: tuple[int, ClosedRows] | None = None
        self._late = 0

    def _fold(self, events: Sequence[StampedEvent], late: int) -> None:
        self._clear()
        self._late = late
        for stamped in events:
            self._append(stamped)

    def _append(self, stamped: StampedEvent) -> None:
        number, event = len(self._events), stamped.event
        stamp = max(stamped.stamp, self._stamps[-1]) if self._stamps else float(stamped.stamp)
        instant = Instant(int(stamped.step), stamp)
        before = self._progress[-1] if self._progress else NO_PROGRESS
        if isinstance(event, GraphChanged):
            seen_from = self.frames.pose(event.delta.node.id) if isinstance(event.delta, NodeAdded) else None
            self._maps.append(number, instant, event, seen_from)
            if number in self._maps.begun_by:
                before = before._replace(blocked=frozenset())  # These edges belong to the previous map.
                self._rows.begin_map(number, instant, event.delta.cause, self._maps.begun_by[number])
        row = describe_event(event, before)
        self._rows.take(number, instant, event, before, row)
        self._progress.append(row.after)
        self._stamps.append(stamp)
        self._events.append(stamped)


def adjacent_instant(timeline: Timeline, at: Instant, *, forwards: bool) -> Instant | None:
    """Return the moment of the next event at another time, or of the previous one; linear in the events at the same
    time."""
    found = _adjacent(range(len(timeline.events)), timeline.instant, at, forwards=forwards)
    return None if found is None else timeline.instant(found)


def adjacent_mark(timeline: Timeline, at: Instant, kind: MarkKind | None, *, forwards: bool) -> Mark | None:
    """Return the next mark of a kind at another time, or the previous one; linear in the marks at the same time."""
    return _adjacent(timeline.marks_until(None, kind), attrgetter("instant"), at, forwards=forwards)


def _adjacent(rows: Sequence[_Row], instant: Callable[[_Row], Instant], at: Instant, *, forwards: bool) -> _Row | None:
    # Several events may have the same stamp, because the clock stands still between queries, and the page knows only
    # the time.
    place = bisect_right(rows, at.step, key=lambda row: instant(row).step)
    numbers = range(place, len(rows)) if forwards else range(place - 1, -1, -1)
    return next((rows[n] for n in numbers if abs(instant(rows[n]).stamp - at.stamp) >= _SAME_S), None)


def _loaded_until(events: Sequence[StampedEvent]) -> FrameId:
    """Return the step at which the first map of a run was loaded, -1 if none was."""
    first = events[0].event if events else None
    return events[0].step if isinstance(first, GraphChanged) and first.delta.cause is Cause.LOAD else -1


def _late_count(events: Sequence[StampedEvent]) -> int:
    """Return the number of events that come after an event of a later step."""
    latest = itertools.accumulate(map(_STEP, events), max)
    return sum(stamped.step < step for stamped, step in zip(events, latest, strict=True))
