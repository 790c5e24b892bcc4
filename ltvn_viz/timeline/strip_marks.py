"""The marks of a run as rows of integers for the page's timeline, and the address from which the page fetches them.

Owns the format of a row; `ltvn_core.navigation.event_table` decides which events get a mark. Rows of a run are only
appended, so a page that has the first rows requests only the rest. Rows are made in the session's thread; other threads
may read them.
"""

import json
import math
from bisect import bisect_left
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import MarkKind
from ltvn_core.graph import deltas as d
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.navigation import events as e
from ltvn_core.navigation.event_table import NavigationProgress, describe_event
from ltvn_core.worlds import PersonLeft, PersonMoved
from ltvn_viz.server.strip_kinds import KIND_NUMBERS, STRIP_STYLES, QueryEnd, ShownKind, StripKind

STRIP_NUMBERS = 10**8
"""Factor in the number by which a page requests rows: the number of the run times this factor, plus the first row."""
_KEPT = 4
"""Number of runs whose rows are kept; a page that lags behind asks again for the current run."""
_NOBODY = -1
_MOVED = 2e-3
"""Least change of the pose between two images, in metres or radians, of a robot that moves."""


class StripRow(NamedTuple):
    """One mark of the timeline."""

    time_ms: int
    """Time after the beginning of the run in milliseconds, rounded up, so that seeking to it shows the event."""
    kind: ShownKind
    first: int = _NOBODY
    """Subject of the mark: source and target of an edge, a node, a door, a query and its goal; -1 for nothing."""
    second: int = _NOBODY


class StripMarks:
    """The rows of one run."""

    def __init__(self, run: Timeline) -> None:
        """Start without rows."""
        self.rows: list[StripRow] = []
        self.start_s = run.start_s
        self._events: Sequence[e.StampedEvent] = run.events
        self._taken = 0
        self._frames = 0
        self._latest: dict[ShownKind, float] = {}
        """Time of the latest mark of each kind, in seconds."""
        self._p: dict[EdgeKey, float] = {}
        self._under_way: list[float] = []
        """Times at which a query began or ended, by turns, in seconds."""

    def is_of(self, run: Timeline) -> bool:
        """Tell whether the rows are still valid: the run began at the same time, and its events were only appended."""
        return self._events is run.events and self.start_s == run.start_s

    def take_in(self, run: Timeline) -> None:
        """Make rows of the events and images since the last call; constant time for each."""
        rows: list[StripRow] = []
        for number in range(self._taken, len(run.events)):
            event, stamp = run.events[number].event, run.instant(number).stamp
            if isinstance(event, e.QueryStarted if len(self._under_way) % 2 == 0 else e.QueryEnded):
                self._under_way.append(stamp)
            if (found := self._mark(event, run.progress_before(number))) is not None and self._is_due(found[0], stamp):
                rows.append(self._row(stamp, *found))
        self._taken = len(run.events)
        self.rows += sorted([*rows, *self._of_images(run)], key=lambda row: row.time_ms)

    def _row(self, stamp: float, kind: ShownKind, first: int = _NOBODY, second: int = _NOBODY) -> StripRow:
        self._latest[kind] = stamp
        milliseconds = math.ceil(1000 * max(0.0, stamp - self.start_s) - 1e-6)
        return StripRow(milliseconds, kind, first, second)

    def _is_due(self, kind: ShownKind, stamp: float) -> bool:
        """Tell whether an event gets a mark: always, unless it goes on for some time and has one that is so recent."""
        span_s = STRIP_STYLES[kind].span_s if kind in STRIP_STYLES else 0.0
        return span_s == 0 or stamp >= self._latest.get(kind, -math.inf) + span_s

    def _of_images(self, run: Timeline) -> Iterator[StripRow]:
        """Yield rows for the times at which there are images, and at which the robot was moving."""
        for number in range(self._frames, len(run.frames)):
            stamp = run.frames.stamp(number)
            if self._is_due(StripKind.RECORDED, stamp):
                yield self._row(stamp, StripKind.RECORDED)
            is_query = bisect_left(self._under_way, stamp) % 2 == 1
            kind = StripKind.DRIVEN_BY_QUERY if is_query else StripKind.DRIVEN_BY_PERSON
            if self._is_due(kind, stamp) and self._moved(run, number):
                yield self._row(stamp, kind)
        self._frames = len(run.frames)

    def _moved(self, run: Timeline, number: int) -> bool:
        before = run.frames.driven_pose(max(number - 1, 0))
        return bool(np.abs(run.frames.driven_pose(number) - before).max() > _MOVED)

    def _mark(self, event: e.Event, before: NavigationProgress) -> tuple[ShownKind, int, int] | None:
        """Return kind and subject of an event's mark; only an event that may have one of the table is described."""
        match event:
            case e.GraphChanged(delta=d.EdgeAdded(edge=edge)):
                self._p[edge.source, edge.target] = edge.belief.p
            case e.GraphChanged(delta=d.BeliefUpdated(source=source, target=target, belief=belief)):
                was = self._p.get((source, target), belief.p)
                self._p[source, target] = belief.p
                kind = StripKind.ROSE if belief.p > was else StripKind.FELL
                return None if belief.p == was else (kind, source, target)
            case e.QueryStarted(query=query, goal=goal):
                return MarkKind.QUERY_START, query, goal
            case e.QueryEnded(query=query, outcome=outcome):
                return MarkKind.QUERY_END, query, _end(outcome)
            case e.Judged(query=query, reached=False) if before.ended and before.ended.outcome is e.Outcome.ARRIVED:
                return MarkKind.QUERY_END, query, QueryEnd.WRONG
            case e.Planned(nodes=()):
                return None if before.last_plan == () else (StripKind.NO_PLAN, _NOBODY, _NOBODY)
            case e.Planned(nodes=nodes) if not before.last_plan:
                return StripKind.PLANNED, nodes[0], nodes[-1]
            case e.WorldChanged(change=PersonMoved() | PersonLeft()):
                return StripKind.PEOPLE_MOVED, _NOBODY, _NOBODY
            case _:
                pass
        if isinstance(event, e.GraphChanged) and event.delta.cause in d.BULK_CAUSES:
            return None  # The changes that make a whole map are by far the most frequent events.
        row = describe_event(event, before)
        first, second, *_ = (*row.about, _NOBODY, _NOBODY)
        kind = MarkKind.ADD if row.mark is MarkKind.EXPAND else row.mark
        return None if kind is None else (kind, first, second)


def _end(outcome: e.Outcome) -> QueryEnd:
    if outcome is e.Outcome.CANCELLED:
        return QueryEnd.CANCELLED
    return QueryEnd.REACHED if outcome is e.Outcome.ARRIVED else QueryEnd.FAILED


class StripLibrary:
    """The rows of the runs that were shown recently, each with a number that is never used again."""

    def __init__(self) -> None:
        """Start without runs."""
        self._numbers: WeakKeyDictionary[Timeline, int] = WeakKeyDictionary()
        self._strips: OrderedDict[int, StripMarks] = OrderedDict()
        self._next = 1

    def of(self, run: Timeline) -> tuple[int, int]:
        """Return the number of a run and its present number of rows; only for the session's thread."""
        number = self._numbers.get(run, 0)
        strip = self._strips.get(number)
        if strip is None or not strip.is_of(run):
            number = self._next
            strip = StripMarks(run)
            self._next += 1
            self._numbers[run] = number
            self._strips[number] = strip
            if len(self._strips) > _KEPT:
                self._strips.popitem(last=False)
        strip.take_in(run)
        return number, len(strip.rows)

    def rows_from(self, number: int) -> bytes | None:
        """Return rows of a run as JSON, from a first row on; None if the run is no longer known. See `STRIP_NUMBERS`.

        May be called in any thread.
        """
        run, first = divmod(number, STRIP_NUMBERS)
        strip = self._strips.get(run)
        if strip is None:
            return None
        rows = [(time_ms, KIND_NUMBERS[kind], *about) for time_ms, kind, *about in strip.rows[first:]]
        return json.dumps({"run": run, "first": first, "rows": rows}, separators=(",", ":")).encode()
