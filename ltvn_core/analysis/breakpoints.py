"""Stopping where a person asked for it, live or in a recording.

Owns the watching. The kinds are `analysis.breakpoint_kinds`, how one is typed `analysis.breakpoint_text`, when one is
met `analysis.breakpoint_rules`; what to do at a hit is the caller's.
"""

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from ltvn_core.analysis.breakpoint_kinds import Breakpoint
from ltvn_core.analysis.breakpoint_rules import Memory, met
from ltvn_core.nav.events import Stamped


class Hit(NamedTuple):
    """A breakpoint was met."""

    moment: Stamped
    breakpoints: tuple[Breakpoint, ...]
    """Those that were met at once, at least one, in the order they were given."""
    why: str
    """One line for a person."""


class Watcher:
    """Looks at events as they come. Each costs constant time per breakpoint, memory is one belief per edge."""

    def __init__(self, breakpoints: Sequence[Breakpoint]) -> None:
        """Watch for these. Feed the events from the map's beginning, so that beliefs are known when they change."""
        self.breakpoints = tuple(breakpoints)
        self._memory = Memory()

    def consume(self, stamped: Stamped) -> Hit | None:
        """Return the hit of an event, if it is one; to be called with every event once, in order."""
        change = self._memory.take(stamped.event)
        hits = [(each, why) for each in self.breakpoints if (why := met(each, change)) is not None]
        if not hits:
            return None
        breakpoints, reasons = zip(*hits, strict=True)
        return Hit(stamped, breakpoints, "; ".join(dict.fromkeys(reasons)))

    def changed(self, breakpoints: Sequence[Breakpoint]) -> None:
        """Watch for these from now on, knowing all that was seen so far."""
        self.breakpoints = tuple(breakpoints)


def find_hits(events: Iterable[Stamped], breakpoints: Sequence[Breakpoint]) -> Iterator[Hit]:
    """Yield every hit in a recording; linear in the events."""
    watcher = Watcher(breakpoints)
    return (hit for stamped in events if (hit := watcher.consume(stamped)) is not None)
