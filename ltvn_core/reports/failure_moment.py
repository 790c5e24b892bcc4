"""Finds the moment of a failure in the recording of an episode."""

from pathlib import Path

import numpy as np

from ltvn_core.errors import LtvnError
from ltvn_core.evaluation.query_result import FailureCause
from ltvn_core.graph.deltas import Cause
from ltvn_core.navigation.events import AttemptEnded, Collided, GraphChanged, QueryEnded, StampedEvent
from ltvn_core.recording.reader import Recording

BEFORE_S = 3.0
"""Playback starts this long before the failure."""


def moment_s(recording: Path, failure: FailureCause | None) -> float | None:
    """Return where playback should start, in seconds after the recording's beginning; None if it cannot be read.

    For collisions that is shortly before the last one, after a wrong turn before the last attempt that failed, and
    otherwise before the end.
    """
    try:
        opened = Recording.open(recording)
        events = opened.events
    except LtvnError:
        return None
    stamps = [stamped.stamp for stamped in events if _tells(stamped, failure)]
    ends = [stamped.stamp for stamped in events if isinstance(stamped.event, QueryEnded)]
    if not stamps and not ends:
        return None
    return max(0.0, (stamps or ends)[-1] - _beginning_s(opened, events) - BEFORE_S)


def _tells(stamped: StampedEvent, failure: FailureCause | None) -> bool:
    if failure is FailureCause.COLLISION:
        return isinstance(stamped.event, Collided)
    if failure in (FailureCause.SPURIOUS_EDGE, FailureCause.MISLOCALISED, FailureCause.STEP_LIMIT):
        return isinstance(stamped.event, AttemptEnded) and not stamped.event.succeeded
    return False


def _beginning_s(recording: Recording, events: list[StampedEvent]) -> float:
    """Return the time at which driving began; images of a loaded map are older."""
    first = events[0]
    poses = recording.poses
    loaded = isinstance(first.event, GraphChanged) and first.event.delta.cause is Cause.LOAD
    stamps = poses.stamps[poses.steps > first.step] if loaded else poses.stamps
    return float(np.min(stamps, initial=np.inf)) if len(stamps) else first.stamp
