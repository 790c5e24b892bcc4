"""From moment to moment as the page shows them: the next that is another time, before or after.

Owns that rule. Two steps may share a stamp, for the clock stands still between queries; by its clock the page cannot
tell them apart.
"""

from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import Instant, Mark, MarkKind

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
    place, mark = _start(at, forwards=forwards), None
    while abs(place.stamp - at.stamp) < _SAME_S:
        mark = timeline.next_mark(place, kind) if forwards else timeline.previous_mark(place, kind)
        if mark is None:
            return None
        place = mark.instant
    return mark


def _start(at: Instant, *, forwards: bool) -> Instant:
    """Return where to look from: back from a robot that stands, what happened in its last step is before it, too."""
    return at if forwards else at._replace(step=at.step + 1)
