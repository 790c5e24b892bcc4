"""Breakpoints that a person set in the page, and where the live run and the recordings met them.

Owns the list, what of it is news, and how hits are found without looking at an event twice. When a breakpoint is met is
`ltvn_core.analysis.breakpoints`; what happens then is `ltvn_viz.session.session_loop`.
"""

from bisect import bisect_right
from collections import deque
from collections.abc import Iterator, Sequence
from typing import NamedTuple
from weakref import WeakKeyDictionary

from ltvn_core.analysis.breakpoints import Breakpoint, BreakpointHit, breakpoint_hit, find_breakpoint_hits
from ltvn_core.analysis.timeline import Timeline

STAMP_EPSILON_S = 1e-6
"""More than is lost when a stamp is taken apart and put together again."""
_KEPT = 1000
"""Number of latest hits that a live run remembers."""


class BreakpointStop(NamedTuple):
    """A place in time at which breakpoints were met."""

    time_s: float
    """Seconds after the run's beginning."""
    hit: BreakpointHit


class BreakpointMonitor:
    """Breakpoints of a person."""

    def __init__(self) -> None:
        """Watch for nothing, which costs nothing."""
        self.breakpoints: tuple[Breakpoint, ...] = ()
        self.stops: deque[BreakpointStop] = deque(maxlen=_KEPT)
        """Stops of the live run at breakpoints, also those before they were set."""
        self._news: BreakpointStop | None = None
        self._found: WeakKeyDictionary[Timeline, tuple[BreakpointStop, ...]] = WeakKeyDictionary()

    def change(self, breakpoints: Sequence[Breakpoint], live: Timeline) -> None:
        """Stop at these from now on; where the live run met them before is found once. Linear in its events."""
        self.breakpoints = tuple(breakpoints)
        self.stops.clear()
        self._found.clear()
        if breakpoints:
            self.stops.extend(_stops(live, self.breakpoints))

    def consume(self, live: Timeline) -> None:
        """Look at the newest event of the live run."""
        if not self.breakpoints:
            return
        hit = breakpoint_hit(live, len(live.events) - 1, self.breakpoints)
        if hit is not None:
            self._news = BreakpointStop(_time(hit, live.start_s), hit)
            self.stops.append(self._news)

    def announce(self, stop: BreakpointStop) -> None:
        """Let a stop be news that something else found."""
        self._news = stop

    def take_latest(self) -> BreakpointStop | None:
        """Return the latest stop that was not returned before."""
        news, self._news = self._news, None
        return news

    def stops_of(self, run: Timeline) -> tuple[BreakpointStop, ...]:
        """Return all stops of a recording in order; linear in its events once for each change of the breakpoints."""
        if not self.breakpoints:
            return ()
        if run not in self._found:
            self._found[run] = tuple(_stops(run, self.breakpoints))
        return self._found[run]

    def first_between(self, run: Timeline, after_s: float, until_s: float) -> BreakpointStop | None:
        """Return the first stop of a recording later than one time and not later than another."""
        stops = self.stops_of(run)
        place = bisect_right(stops, after_s, key=lambda stop: stop.time_s)
        return stops[place] if place < len(stops) and stops[place].time_s <= until_s else None


def _stops(run: Timeline, breakpoints: Sequence[Breakpoint]) -> Iterator[BreakpointStop]:
    return (BreakpointStop(_time(hit, run.start_s), hit) for hit in find_breakpoint_hits(run, breakpoints))


def _time(hit: BreakpointHit, start_s: float) -> float:
    return max(0.0, hit.moment.stamp - start_s) + STAMP_EPSILON_S
