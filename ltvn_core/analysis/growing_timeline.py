"""The timeline of a run that is still going on: indexed event by event, looked at whenever one likes.

Owns what is kept between two looks. A look costs a copy of the rows, not another pass.
"""

from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_builder import TimelineBuilder
from ltvn_core.navigation.events import StampedEvent


class GrowingTimeline:
    """Takes events as they happen. One thread takes and looks; the timelines it gave out may be read in any."""

    def __init__(self) -> None:
        """Begin with nothing."""
        self._index = TimelineBuilder()
        self._events: list[StampedEvent] = []
        self._disorder = False

    def __len__(self) -> int:
        """Return how many events were taken."""
        return len(self._events)

    def take(self, stamped: StampedEvent) -> None:
        """Take in the next event, in constant time."""
        if self._events and stamped.step < self._events[-1].step:
            self._disorder = True
        if not self._disorder:
            self._index.take(len(self._events), stamped)
        self._events.append(stamped)

    def timeline(self) -> Timeline:
        """Return the timeline of what was taken so far, which stays as it is; once events were in disorder, anew."""
        if self._disorder:
            return Timeline.of(self._events)
        return Timeline.built(self._index, tuple(self._events))
