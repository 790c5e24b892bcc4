"""Breakpoints that a person set in the page, and where the live run and the recordings met them.

Owns the list, what of it is news, and how hits are found without looking at an event twice. When a breakpoint is met is
`ltvn_core.analysis.breakpoint_rules`; what happens then is `ltvn_viz.session.breakpoint_stop`.
"""

from bisect import bisect_right
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from itertools import accumulate
from typing import NamedTuple, Protocol
from weakref import WeakKeyDictionary

from ltvn_core.analysis.breakpoint_kinds import Breakpoint
from ltvn_core.analysis.breakpoint_watcher import BreakpointHit, BreakpointWatcher
from ltvn_core.navigation.events import StampedEvent
from ltvn_viz.debugger.context import STAMP_EPSILON_S

_KEPT = 1000
"""A live run remembers so many of its latest hits."""


class BreakpointStop(NamedTuple):
    """A place in time at which breakpoints were met."""

    time_s: float
    """Seconds after the run's beginning."""
    hit: BreakpointHit


class EventSource(Protocol):
    """What was, or is, going on."""

    @property
    def events(self) -> Sequence[StampedEvent]:
        """All events so far."""
        ...


class BreakpointMonitor:
    """What a person wants to stop at."""

    def __init__(self) -> None:
        """Watch for nothing, which costs nothing."""
        self.breakpoints: tuple[Breakpoint, ...] = ()
        self.stops: deque[BreakpointStop] = deque(maxlen=_KEPT)
        """Where the live run met them, also before they were set."""
        self._watcher = BreakpointWatcher(())
        self._news: BreakpointStop | None = None
        self._found: WeakKeyDictionary[EventSource, tuple[BreakpointStop, ...]] = WeakKeyDictionary()

    def change(self, breakpoints: Sequence[Breakpoint], past: Iterable[StampedEvent], start_s: float) -> None:
        """Watch for these from now on; what the live run met in its `past` is found once. Linear in the past."""
        self.breakpoints, self._watcher = tuple(breakpoints), BreakpointWatcher(tuple(breakpoints))
        self.stops.clear()
        self._found.clear()
        if breakpoints:
            self.stops.extend(_stops(self._watcher, past, start_s))

    def consume(self, stamped: StampedEvent, start_s: float) -> None:
        """Look at an event of the live run as it comes."""
        if self.breakpoints and (hit := self._watcher.consume(stamped)) is not None:
            self._news = BreakpointStop(_time(stamped.stamp, start_s), hit)
            self.stops.append(self._news)

    def announce(self, stop: BreakpointStop) -> None:
        """Let a stop be news that something else found."""
        self._news = stop

    def take_latest(self) -> BreakpointStop | None:
        """Return the latest stop that nobody asked for yet."""
        news, self._news = self._news, None
        return news

    def stops_of(self, run: EventSource, start_s: float) -> tuple[BreakpointStop, ...]:
        """Return all stops of a recording in order; linear in its events once for each change of the breakpoints."""
        if not self.breakpoints:
            return ()
        if run not in self._found:
            self._found[run] = tuple(_stops(BreakpointWatcher(self.breakpoints), run.events, start_s))
        return self._found[run]

    def first_between(self, run: EventSource, start_s: float, after_s: float, until_s: float) -> BreakpointStop | None:
        """Return the first stop of a recording later than one time and not later than another."""
        stops = self.stops_of(run, start_s)
        place = bisect_right(stops, after_s, key=lambda stop: stop.time_s)
        return stops[place] if place < len(stops) and stops[place].time_s <= until_s else None


def _stops(watcher: BreakpointWatcher, events: Iterable[StampedEvent], start_s: float) -> Iterator[BreakpointStop]:
    """Yield stops in order; an event that comes late is filed under the latest moment, as timelines do."""
    events = tuple(events)
    for stamped, stamp in zip(events, accumulate((each.stamp for each in events), max), strict=True):
        if (hit := watcher.consume(stamped)) is not None:
            yield BreakpointStop(_time(stamp, start_s), hit)


def _time(stamp: float, start_s: float) -> float:
    return max(0.0, stamp - start_s) + STAMP_EPSILON_S
