"""Breakpoints that a person set in the page, and the moments at which the live run and recordings met them.

Owns the list of breakpoints, the latest stop, and a search that examines each event only once.
`ltvn_core.analysis.breakpoints` decides whether an event meets a breakpoint; `ltvn_viz.session.session_loop` stops
there.
"""

from bisect import bisect_right
from collections import deque
from collections.abc import Iterator, Sequence
from typing import NamedTuple
from weakref import WeakKeyDictionary

from ltvn_core.analysis.breakpoints import Breakpoint, BreakpointHit, breakpoint_hit, find_breakpoint_hits
from ltvn_core.analysis.timeline import Timeline

STAMP_EPSILON_S = 1e-6
"""Margin in seconds, larger than the rounding error when the run's start is subtracted from a stamp and added again."""
_KEPT = 1000
"""Maximum number of stops that a live run keeps, the latest ones."""


class BreakpointStop(NamedTuple):
    """A moment at which breakpoints were met."""

    time_s: float
    """Time in seconds after the run's beginning."""
    hit: BreakpointHit


class BreakpointMonitor:
    """A person's breakpoints, and the moments at which runs met them."""

    def __init__(self) -> None:
        """Start without breakpoints; then watching a run costs no time."""
        self.breakpoints: tuple[Breakpoint, ...] = ()
        self.stops: deque[BreakpointStop] = deque(maxlen=_KEPT)
        """Stops of the live run, including events from before the breakpoints were set."""
        self._news: BreakpointStop | None = None
        self._found: WeakKeyDictionary[Timeline, tuple[BreakpointStop, ...]] = WeakKeyDictionary()

    def change(self, breakpoints: Sequence[Breakpoint], live: Timeline) -> None:
        """Replace all breakpoints, and search the live run so far for them. Linear in its events."""
        self.breakpoints = tuple(breakpoints)
        self.stops.clear()
        self._found.clear()
        if breakpoints:
            self.stops.extend(_stops(live, self.breakpoints))

    def consume(self, live: Timeline) -> None:
        """Check whether the newest event of the live run meets a breakpoint."""
        if not self.breakpoints:
            return
        hit = breakpoint_hit(live, len(live.events) - 1, self.breakpoints)
        if hit is not None:
            self._news = BreakpointStop(_time(hit, live.start_s), hit)
            self.stops.append(self._news)

    def announce(self, stop: BreakpointStop) -> None:
        """Set `stop`, which was found elsewhere, as the latest one."""
        self._news = stop

    def take_latest(self) -> BreakpointStop | None:
        """Return the latest stop; None if it was returned before."""
        news, self._news = self._news, None
        return news

    def stops_of(self, run: Timeline) -> tuple[BreakpointStop, ...]:
        """Return all stops of a recording in order. The first call after a change of the breakpoints is linear in the
        events."""
        if not self.breakpoints:
            return ()
        if run not in self._found:
            self._found[run] = tuple(_stops(run, self.breakpoints))
        return self._found[run]

    def first_between(self, run: Timeline, after_s: float, until_s: float) -> BreakpointStop | None:
        """Return the first stop of a recording with `after_s` < time <= `until_s`, in seconds after the beginning."""
        stops = self.stops_of(run)
        place = bisect_right(stops, after_s, key=lambda stop: stop.time_s)
        return stops[place] if place < len(stops) and stops[place].time_s <= until_s else None


def _stops(run: Timeline, breakpoints: Sequence[Breakpoint]) -> Iterator[BreakpointStop]:
    return (BreakpointStop(_time(hit, run.start_s), hit) for hit in find_breakpoint_hits(run, breakpoints))


def _time(hit: BreakpointHit, start_s: float) -> float:
    return max(0.0, hit.moment.stamp - start_s) + STAMP_EPSILON_S
