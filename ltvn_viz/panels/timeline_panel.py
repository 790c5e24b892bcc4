"""The timeline at the foot of the page: tells the pages which moment is on show, not more often than they can draw.

The strip itself is drawn by the page's script (`static/timeline.js`), which fetches the marks when there are new ones.
"""

import json
import time
from collections.abc import Callable
from dataclasses import replace

from ltvn_viz.session.snapshot import Snapshot, TimelineStatus

TELL_EVERY_S = 0.1
"""Time that only goes on is told so often; whatever else is new is told at once."""


class TimelinePanel:
    """Tells pages the moment."""

    def __init__(self, tell: Callable[[str], None], clock: Callable[[], float] = time.monotonic) -> None:
        """Tell all pages by `tell`, which returns at once."""
        self._tell = tell
        self._clock = clock
        self._told = TimelineStatus()
        self._due = float("-inf")

    def show(self, snapshot: Snapshot) -> None:
        """Tell the moment if it is another one."""
        told, now = self._told, snapshot.timeline
        went_on = replace(told, time_s=now.time_s, length_s=now.length_s, marks=now.marks)
        if now == told or (now == went_on and self._clock() < self._due):
            return
        self._told, self._due = now, self._clock() + TELL_EVERY_S
        self._tell(_moment_message(now))


def _moment_message(time: TimelineStatus) -> str:
    """Write which moment is on show; times in whole milliseconds."""
    moment = {
        "type": "moment",
        "run": time.run,
        "marks": time.marks,
        "at": round(1000 * time.time_s),
        "length": round(1000 * time.length_s),
        "now": time.is_now,
        "replay": time.is_replay,
        "playing": time.is_playing,
        "speed": time.speed,
    }
    return json.dumps(moment)
