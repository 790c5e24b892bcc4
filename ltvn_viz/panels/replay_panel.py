"""The “Replay” tab with the recordings, and the timeline at the foot of the page with the moment on show.

The page's script draws the timeline (`static/timeline.js`) and fetches new marks.
"""

import json
import time
from collections.abc import Callable
from dataclasses import replace

import viser

from ltvn_core.terminal_text import count_text
from ltvn_viz.panels.html_widgets import ActionButton, HtmlBlock, button_row, note
from ltvn_viz.session.snapshot import Snapshot, TimelineStatus
from ltvn_viz.wishes.modes import STANDING
from ltvn_viz.wishes.wish_table import Action

NONE_YET: str = "no recordings yet"
IMPORT = "import: "
"""Prefix of drives in other formats in the list."""


class ReplayPanel:
    """Controls to choose and open a recording, and to return to the robot."""

    def __init__(self, gui: viser.GuiApi) -> None:
        """Add the controls to the tab that is open."""
        HtmlBlock(
            gui, note("Watch a recording in this page: the timeline at the bottom plays it and jumps to any time.")
        )
        self._names = gui.add_dropdown("Recording", [NONE_YET], disabled=True)
        self.buttons = HtmlBlock(gui)
        self.about = HtmlBlock(gui)
        self.making = HtmlBlock(gui)
        self._choices: dict[str, ActionButton] = {}
        self._opened = self._to_choose = ""

    def show(self, snapshot: Snapshot) -> None:
        """Show the list of recordings, and the position in the open one."""
        self._list(snapshot)
        cancel = ActionButton(Action.CANCEL, hint="leave nothing behind", is_enabled=snapshot.mode in STANDING)
        self.making.show(button_row(cancel) if snapshot.is_making else "")
        replay = snapshot.replay
        if replay is not None:
            self._choose(replay)
        self.buttons.show(self._buttons(snapshot))
        self.about.show(_about(snapshot, self._names.value))

    def _buttons(self, snapshot: Snapshot) -> str:
        chosen = self._choices.get(self._names.value, ActionButton(Action.OPEN))
        close = () if snapshot.replay is None else (ActionButton(Action.CLOSE),)
        return button_row(replace(chosen, is_enabled=chosen.target is not None), *close, mode=snapshot.mode)

    def _list(self, snapshot: Snapshot) -> None:
        names = (*snapshot.recordings, *(IMPORT + name for name in snapshot.sources))
        if names == tuple(self._choices):
            return
        self._choices = {
            **{IMPORT + name: ActionButton(Action.IMPORT, target=name) for name in snapshot.sources},
            **{name: ActionButton(Action.OPEN, target=name) for name in snapshot.recordings},
        }
        self._choices = {name: self._choices[name] for name in names}
        chosen = self._names.value
        self._names.options = names or (NONE_YET,)
        if chosen in self._choices:
            self._names.value = chosen
        self._names.disabled = not names

    def _choose(self, name: str) -> None:
        if name != self._opened:
            self._opened = self._to_choose = name
        if self._to_choose in self._choices:  # A new recording is listed a little later than it is opened.
            self._names.value, self._to_choose = self._to_choose, ""


def _about(snapshot: Snapshot, chosen: str) -> str:
    if snapshot.replay is None:
        return note(snapshot.recordings[chosen]) if chosen in snapshot.recordings else ""
    moment = snapshot.moment
    return note(
        f"{snapshot.replay}: {snapshot.timeline.time_s:.1f} of {snapshot.timeline.length_s:.1f} s, "
        f"{count_text(moment.frames, 'image')}, {count_text(len(moment.graph.ids), 'node')}, "
        f"{count_text(len(moment.graph.p), 'edge')}."
    )


TELL_EVERY_S, TELL_LIVE_EVERY_S = 0.1, 0.5
"""Intervals of updates while only the time changes, in seconds, of a played and of the live run; other changes are sent
at once."""


class TimelinePanel:
    """Sends the moment on show to all pages."""

    def __init__(self, tell: Callable[[str], None], clock: Callable[[], float] = time.monotonic) -> None:
        """Send messages by `tell`, which returns at once."""
        self._tell = tell
        self._clock = clock
        self._told = TimelineStatus()
        self._due = float("-inf")

    def show(self, snapshot: Snapshot) -> None:
        """Send the moment if it changed."""
        told = self._told
        now = snapshot.timeline
        went_on = replace(told, time_s=now.time_s, length_s=now.length_s, marks=now.marks)
        if now == told or (now == went_on and self._clock() < self._due):
            return
        self._told = now
        self._due = self._clock() + (TELL_LIVE_EVERY_S if now.is_now else TELL_EVERY_S)
        self._tell(_moment_message(now))


def _moment_message(time: TimelineStatus) -> str:
    """Return a message with the moment on show; times are in whole milliseconds."""
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
