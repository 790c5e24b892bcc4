"""Breakpoints: kinds of events at which the run or its replay stops, anywhere or only at a node or an edge.

Owns the list of breakpoints and the latest stop. `ltvn_core.navigation.event_table` decides which events get a mark;
`ltvn_viz.session.session_loop` stops at the marks that a breakpoint names.
"""

from bisect import bisect_right
from collections.abc import Sequence
from typing import NamedTuple

from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import Mark, MarkKind
from ltvn_core.types import NodeId

STAMP_EPSILON_S = 1e-6
"""Margin in seconds, larger than the rounding error when the run's start is subtracted from a stamp and added again."""


class Breakpoint(NamedTuple):
    """Stop at each event of one kind."""

    kind: MarkKind
    ids: tuple[NodeId, ...] = ()
    """A node, or the two nodes of an edge; empty for events anywhere."""

    def is_met_by(self, mark: Mark) -> bool:
        """Tell whether the run stops at this mark."""
        return mark.kind is self.kind and self.ids in ((), mark.ids, *((node,) for node in mark.ids))


class BreakpointMonitor:
    """A person's breakpoints, and the latest stop."""

    def __init__(self) -> None:
        """Start without breakpoints."""
        self.breakpoints: tuple[Breakpoint, ...] = ()
        self._news: tuple[float, str] | None = None

    def stops_among(self, marks: Sequence[Mark]) -> Sequence[Mark]:
        """Return the marks that meet a breakpoint, in order."""
        return [mark for mark in marks if any(each.is_met_by(mark) for each in self.breakpoints)]

    def consume(self, live: Timeline) -> None:
        """Check whether the newest event of the live run meets a breakpoint."""
        for mark in self.stops_among(live.marks[-1:]):
            if mark.event == len(live.events) - 1:
                self.announce(live, mark)

    def announce(self, run: Timeline, mark: Mark) -> None:
        """Set a mark as the latest stop."""
        self._news = time_of(run, mark), mark.text

    def take_latest(self) -> tuple[float, str] | None:
        """Return time and reason of the latest stop, in seconds after the beginning; None if it was returned before."""
        news, self._news = self._news, None
        return news

    def first_between(self, run: Timeline, after_s: float, until_s: float) -> Mark | None:
        """Return the first stop of a recording with `after_s` < time <= `until_s`, in seconds after the beginning."""
        if not self.breakpoints:
            return None
        first, last = (
            bisect_right(run.marks, each, key=lambda mark: time_of(run, mark)) for each in (after_s, until_s)
        )
        return next(iter(self.stops_among(run.marks[first:last])), None)


def time_of(run: Timeline, mark: Mark) -> float:
    """Return the time of a mark in seconds after the beginning, rounded up so that a seek never ends just before it."""
    return max(0.0, mark.instant.stamp - run.start_s) + STAMP_EPSILON_S
