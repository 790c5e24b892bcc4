"""The marks of a run as rows of integers for the page's timeline, and the address from which the page fetches them.

Owns the format of a row; `ltvn_core.analysis.timeline_rows` decides which events get a mark. Rows of a run are only
appended, so a page that has the first rows requests only the rest. Rows are made in the session's thread; other threads
may read them.

Owns also the steps from mark to mark. Several events may have the same stamp, because the clock stands still between
queries. The page knows only the time, so the next mark is always one at another time.
"""

import json
import math
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import Instant, Mark, MarkKind
from ltvn_core.analysis.timeline_rows import event_mark
from ltvn_core.navigation import events as e
from ltvn_core.types import NodeId
from ltvn_viz.server.strip_kinds import DROVE_EVERY_S, QueryEnd, StripKind

STRIP_NUMBERS = 10**8
"""Factor in the number by which a page requests rows: the number of the run times this factor, plus the first row."""
_KEPT = 4
"""Number of runs whose rows are kept; a page that lags behind asks again for the current run."""
_NOBODY = -1
_MOVED = 2e-3
"""Least change of the pose between two images, in metres or radians, of a robot that moves."""
_KINDS: Mapping[MarkKind, StripKind] = {
    MarkKind.ADD: StripKind.ADDED,
    MarkKind.EXPAND: StripKind.ADDED,
    MarkKind.REPLAN: StripKind.REPLANNED,
    MarkKind.SEEN_OPEN: StripKind.SEEN_OPEN,
    MarkKind.SEEN_BLOCKED: StripKind.SEEN_BLOCKED,
    MarkKind.WORLD: StripKind.WORLD_CHANGED,
    MarkKind.DOOR_OPENED: StripKind.DOOR_OPENED,
    MarkKind.DOOR_CLOSED: StripKind.DOOR_CLOSED,
    MarkKind.PRUNE: StripKind.PRUNED,
    MarkKind.FAILURE: StripKind.FAILED,
    MarkKind.COLLISION: StripKind.COLLISION,
}
"""Kinds of all marks except those of queries, whose rows contain more than the mark."""


class StripRow(NamedTuple):
    """One mark of the timeline."""

    time_ms: int
    """Time after the beginning of the run in milliseconds, rounded up, so that seeking to it shows the event."""
    kind: StripKind
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
        self._drove_s = -math.inf
        self._plan: tuple[NodeId, ...] | None = None
        self._arrived = False
        """Whether the robot reported its arrival in the last query."""

    def is_of(self, run: Timeline) -> bool:
        """Tell whether the rows are still valid: the run began at the same time, and its events were only appended."""
        return self._events is run.events and self.start_s == run.start_s

    def take_in(self, run: Timeline) -> None:
        """Make rows of the events and images since the last call; constant time for each."""
        rows = self._drove(run)
        for number in range(self._taken, len(run.events)):
            event = run.events[number].event
            if (found := self._mark(event)) is not None:
                after_s = max(0.0, run.instant(number).stamp - self.start_s)
                rows.append(StripRow(_ms(after_s), *found))
        self._taken = len(run.events)
        self.rows += sorted(rows, key=lambda row: row.time_ms)

    def _drove(self, run: Timeline) -> list[StripRow]:
        """Return a row for each moment at which the robot was moving."""
        rows: list[StripRow] = []
        for number in range(max(self._frames, 1), len(run.frames)):
            stamp = run.frames.stamp(number)
            if stamp < self._drove_s + DROVE_EVERY_S:
                continue
            moved = np.abs(run.frames.driven_pose(number) - run.frames.driven_pose(number - 1)).max()
            if moved > _MOVED:
                self._drove_s = stamp
                rows.append(StripRow(_ms(max(0.0, stamp - self.start_s)), StripKind.DROVE))
        self._frames = len(run.frames)
        return rows

    def _mark(self, event: e.Event) -> tuple[StripKind, int, int] | None:
        found = event_mark(event, self._plan)
        match event:
            case e.QueryStarted(query=query, goal=goal):
                self._plan = None
                return StripKind.QUERY_BEGAN, query, goal
            case e.QueryEnded(query=query, outcome=outcome):
                self._arrived = outcome is e.Outcome.ARRIVED
                return StripKind.QUERY_ENDED, query, _end(outcome)
            case e.Judged(query=query, reached=False) if self._arrived:
                return StripKind.QUERY_ENDED, query, QueryEnd.WRONG
            case e.Planned(nodes=nodes):
                self._plan = nodes
            case _:
                pass
        if found is None:
            return None
        first, second, *_ = (*found.about, _NOBODY, _NOBODY)
        return _KINDS[found.kind], first, second


def _ms(seconds: float) -> int:
    return math.ceil(1000 * seconds - 1e-6)


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
        return json.dumps({"run": run, "first": first, "rows": strip.rows[first:]}, separators=(",", ":")).encode()


_SAME_S = 1e-5
"""Greatest difference in seconds between two moments that are the same moment for the page."""


def adjacent_instant(timeline: Timeline, at: Instant, *, forwards: bool) -> Instant | None:
    """Return the moment of the next event at another time, or of the previous one; linear in the events at the same
    time."""
    found: Instant | None = _start(at, forwards=forwards)
    while found is not None and abs(found.stamp - at.stamp) < _SAME_S:
        found = timeline.next_event(found) if forwards else timeline.previous_event(found)
    return found


def adjacent_mark(timeline: Timeline, at: Instant, kind: MarkKind, *, forwards: bool) -> Mark | None:
    """Return the next mark of a kind at another time, or the previous one; linear in the events at the same time."""
    place = _start(at, forwards=forwards)
    mark = None
    while abs(place.stamp - at.stamp) < _SAME_S:
        mark = timeline.next_mark(place, kind) if forwards else timeline.previous_mark(place, kind)
        if mark is None:
            return None
        place = mark.instant
    return mark


def _start(at: Instant, *, forwards: bool) -> Instant:
    """Return the moment from which to search; a backward search includes the events of the present step."""
    return at if forwards else at._replace(step=at.step + 1)
