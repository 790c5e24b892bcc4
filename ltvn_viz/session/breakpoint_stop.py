"""What happens when a breakpoint is met: a task is held, and the page says which breakpoint it was.

Owns that alone; where breakpoints are met is `why.breakpoint_monitor`. A replay stops by itself.
"""

from ltvn_core.navigation.events import Severity
from ltvn_viz.session.activities.navigation import Navigation
from ltvn_viz.session.activities.playback import Playback
from ltvn_viz.session.app_state import AppState


def handle_breakpoint(state: AppState) -> None:
    """Hold the task if a breakpoint was met since this was asked last."""
    stop = state.live.breakpoint_monitor.take_latest()
    if stop is None:
        return
    held = isinstance(state.activity, Navigation | Playback)
    if isinstance(state.activity, Navigation):
        state.activity.pause()
    how = "Stopped" if held else "Met"
    state.say(f"{how} at {stop.time_s:.1f} s: {stop.hit.why}. Why → “Stop when …” leads there.", Severity.WARN)
    state.inspector.mark_stale()
