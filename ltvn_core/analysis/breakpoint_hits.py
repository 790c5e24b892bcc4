"""Where in a run breakpoints are met, event by event, live or in a recording.

Owns the search. The kinds are `analysis.breakpoint_kinds`, how one is typed `analysis.breakpoint_parser`, when one is
met `analysis.breakpoint_rules`; what to do at a hit is the caller's.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from ltvn_core.analysis.breakpoint_kinds import Breakpoint
from ltvn_core.analysis.breakpoint_rules import EventContext, breakpoint_reason
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import Instant


class BreakpointHit(NamedTuple):
    """An event at which breakpoints are met."""

    moment: Instant
    breakpoints: tuple[Breakpoint, ...]
    """Those that were met at once, at least one, in the order they were given."""
    why: str
    """One line for a person."""


def breakpoint_hit(timeline: Timeline, event: int, breakpoints: Sequence[Breakpoint]) -> BreakpointHit | None:
    """Return the hit of event number `event`, None if it meets no breakpoint. Logarithmic for each breakpoint."""
    context = EventContext(timeline, event)
    hits = [(each, why) for each in breakpoints if (why := breakpoint_reason(each, context)) is not None]
    if not hits:
        return None
    return BreakpointHit(
        moment=timeline.instant(event),
        breakpoints=tuple(each for each, _ in hits),
        why="; ".join(dict.fromkeys(why for _, why in hits)),
    )


def find_breakpoint_hits(timeline: Timeline, breakpoints: Sequence[Breakpoint]) -> Iterator[BreakpointHit]:
    """Yield every hit in a run so far, in order; linear in its events."""
    hits = (breakpoint_hit(timeline, event, breakpoints) for event in range(len(timeline.events)))
    return (hit for hit in hits if hit is not None)
