"""Stopping where a person asked for it, live or in a recording.

Owns the watching. The kinds are `analysis.breakpoint_kinds`, how one is typed `analysis.breakpoint_text`, when one is
met `analysis.breakpoint_rules`; what to do at a hit is the caller's.
"""

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from ltvn_core.analysis.breakpoint_kinds import Breakpoint
from ltvn_core.analysis.breakpoint_rules import BreakpointMemory, breakpoint_reason
from ltvn_core.navigation.events import StampedEvent


class BreakpointHit(NamedTuple):
    """A breakpoint was met."""

    moment: StampedEvent
    breakpoints: tuple[Breakpoint, ...]
    """Those that were met at once, at least one, in the order they were given."""
    why: str
    """One line for a person."""


class BreakpointWatcher:
    """Looks at events as they come. Each costs constant time per breakpoint, memory is one belief per edge."""

    def __init__(self, breakpoints: Sequence[Breakpoint]) -> None:
        """Watch for these. Feed the events from the map's beginning, so that beliefs are known when they change."""
        self.breakpoints = tuple(breakpoints)
        self._memory = BreakpointMemory()

    def consume(self, stamped: StampedEvent) -> BreakpointHit | None:
        """Return the hit of an event, if it is one; to be called with every event once, in order."""
        change = self._memory.take(stamped.event)
        hits = [(each, why) for each in self.breakpoints if (why := breakpoint_reason(each, change)) is not None]
        if not hits:
            return None
        breakpoints, reasons = zip(*hits, strict=True)
        return BreakpointHit(stamped, breakpoints, "; ".join(dict.fromkeys(reasons)))

    def changed(self, breakpoints: Sequence[Breakpoint]) -> None:
        """Watch for these from now on, knowing all that was seen so far."""
        self.breakpoints = tuple(breakpoints)


def find_breakpoint_hits(events: Iterable[StampedEvent], breakpoints: Sequence[Breakpoint]) -> Iterator[BreakpointHit]:
    """Yield every hit in a recording; linear in the events."""
    watcher = BreakpointWatcher(breakpoints)
    return (hit for stamped in events if (hit := watcher.consume(stamped)) is not None)
