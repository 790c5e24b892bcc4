"""The marks of one run as rows of whole numbers for the page's timeline, and where the page fetches them.

Owns the numbers in a row; which events get a mark is `ltvn_core.analysis.timeline_rows`. A run's rows only grow, so
that a page that has some of them asks for the rest. Rows are made in the session's thread; others may read them.

Owns also the way from mark to mark. Two steps may share a stamp, for the clock stands still between queries; by its
clock the page cannot tell them apart, so the next moment is one at another time.
"""

import json
import math
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from typing import NamedTuple
from weakref import WeakKeyDictionary

from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import Instant, Mark, MarkKind
from ltvn_core.analysis.timeline_rows import event_mark
from ltvn_core.navigation import events as e
from ltvn_core.types import NodeId
from ltvn_viz.server.strip_kinds import QueryEnd, StripKind

STRIP_NUMBERS = 10**8
"""A page asks for the rows of a run from one on by a single number: the run's, times this, plus the row's."""
_KEPT = 4
"""Number of runs whose rows are kept; a page that lags behind asks again for the current run."""
_NOBODY = -1
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
"""All but those of queries, whose rows say more than the mark."""


class StripRow(NamedTuple):
    """A mark."""

    time_ms: int
    """Time after the beginning of the run, rounded up, so that seeking to it shows the event."""
    kind: StripKind
    first: int = _NOBODY
    """Subject of the mark: source and target of an edge, a node, a door, a query and its goal; -1 for nothing."""
    second: int = _NOBODY


class StripMarks:
    """The rows of one run."""

    def __init__(self, run: Timeline) -> None:
        """Begin with no row."""
        self.rows: list[StripRow] = []
        self.start_s = run.start_s
        self._events: Sequence[e.StampedEvent] = run.events
        self._taken = 0
        self._plan: tuple[NodeId, ...] | None = None
        self._arrived = False
        """The last query said that it had arrived."""

    def is_of(self, run: Timeline) -> bool:
        """Tell whether the rows still hold: no event was put in before others, and the run began when it did."""
        return self._events is run.events and self.start_s == run.start_s

    def take_in(self, run: Timeline) -> None:
        """Make rows of what happened since the last time; constant time for each event."""
        for number in range(self._taken, len(run.events)):
            event = run.events[number].event
            if (found := self._mark(event)) is not None:
                after_s = max(0.0, run.instant(number).stamp - self.start_s)
                self.rows.append(StripRow(math.ceil(1000 * after_s - 1e-6), *found))
        self._taken = len(run.events)

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


def _end(outcome: e.Outcome) -> QueryEnd:
    if outcome is e.Outcome.CANCELLED:
        return QueryEnd.CANCELLED
    return QueryEnd.REACHED if outcome is e.Outcome.ARRIVED else QueryEnd.FAILED


class StripLibrary:
    """The rows of the runs that were on show lately, by numbers that are never used twice."""

    def __init__(self) -> None:
        """Begin with no run."""
        self._numbers: WeakKeyDictionary[Timeline, int] = WeakKeyDictionary()
        self._strips: OrderedDict[int, StripMarks] = OrderedDict()
        self._next = 1

    def of(self, run: Timeline) -> tuple[int, int]:
        """Return a run's number and how many rows it has now; only for the session's thread."""
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
        """Return as JSON the rows of a run from one on, see `STRIP_NUMBERS`; None for a run that is unknown by now.

        May be called in any thread.
        """
        run, first = divmod(number, STRIP_NUMBERS)
        strip = self._strips.get(run)
        if strip is None:
            return None
        return json.dumps({"run": run, "first": first, "rows": strip.rows[first:]}, separators=(",", ":")).encode()


_SAME_S = 1e-5
"""Moments this near are one to the page."""


def adjacent_instant(timeline: Timeline, at: Instant, *, forwards: bool) -> Instant | None:
    """Return the next time at which anything happens, or the last one before; linear in what is at the same time."""
    found: Instant | None = _start(at, forwards=forwards)
    while found is not None and abs(found.stamp - at.stamp) < _SAME_S:
        found = timeline.next_event(found) if forwards else timeline.previous_event(found)
    return found


def adjacent_mark(timeline: Timeline, at: Instant, kind: MarkKind, *, forwards: bool) -> Mark | None:
    """Return the next mark of a kind at another time, or the last one before; linear in what is at the same time."""
    place = _start(at, forwards=forwards)
    mark = None
    while abs(place.stamp - at.stamp) < _SAME_S:
        mark = timeline.next_mark(place, kind) if forwards else timeline.previous_mark(place, kind)
        if mark is None:
            return None
        place = mark.instant
    return mark


def _start(at: Instant, *, forwards: bool) -> Instant:
    """Return where to look from: back from a robot that stands, what happened in its last step is before it, too."""
    return at if forwards else at._replace(step=at.step + 1)
