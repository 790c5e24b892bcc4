"""What happens when a breakpoint is met: a task is held, and the page says which breakpoint it was.

Owns that alone; where breakpoints are met is `why.watch`. A replay stops by itself.
"""

from ltvn_core.nav.events import Severity
from ltvn_viz.navigation import Navigation
from ltvn_viz.replay import Replay
from ltvn_viz.stage import Stage


def heed(stage: Stage) -> None:
    """Hold the task if a breakpoint was met since this was asked last."""
    stop = stage.live.watch.news()
    if stop is None:
        return
    held = isinstance(stage.activity, Navigation | Replay)
    if isinstance(stage.activity, Navigation):
        stage.activity.pause()
    how = "Stopped" if held else "Met"
    stage.say(f"{how} at {stop.time_s:.1f} s: {stop.hit.why}. Why → “Stop when …” leads there.", Severity.WARN)
    stage.inspector.again()
