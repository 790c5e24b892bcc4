"""The “Replay” tab: open a recording, or import a drive, and move through its time."""

from collections.abc import Callable

import viser

from ltvn_viz.panels.html_widgets import ActionButton, HtmlBlock, button_row, note
from ltvn_viz.server.keymap import Action
from ltvn_viz.session.commands import CloseRecording, Command, ImportDrive, OpenRecording, Pause, Seek
from ltvn_viz.session.modes import Mode
from ltvn_viz.session.snapshot import PlaybackStatus, Snapshot

QUIET = (73, 80, 87)
STEP_S = 0.05
NONE_YET: str = "no recordings yet"
IMPORT = "import: "
"""Marks drives in other formats in the list."""


class ReplayPanel:
    """Choose, open, seek, play."""

    def __init__(self, gui: viser.GuiApi, send: Callable[[Command], None]) -> None:
        """Add the controls to the tab that is open; `send` takes commands and returns at once."""
        HtmlBlock(
            gui, note("Watch a recording in this page: the scene shows the world at the moment of the timeline below.")
        )
        self._names = gui.add_dropdown("Recording", [NONE_YET], disabled=True)
        self._open = gui.add_button("Open", icon=viser.Icon.FOLDER_OPEN, color=QUIET, disabled=True)
        self.time = gui.add_slider("Time (s)", min=0.0, max=1.0, step=STEP_S, initial_value=0.0, visible=False)
        self.play = gui.add_button("Play", icon=viser.Icon.PLAYER_PLAY, visible=False)
        self._close = gui.add_button("Back to the robot", icon=viser.Icon.ARROW_BACK_UP, color=QUIET, visible=False)
        self.about = HtmlBlock(gui)
        self.making = HtmlBlock(gui)
        self._choices: dict[str, Command] = {}
        self._opened = self._to_choose = ""
        self._followed = -1.0
        self._bind(send)

    def show(self, snapshot: Snapshot) -> None:
        """List the recordings and show where in the open one we are."""
        self._list(snapshot)
        self._open.disabled = not self._choices or snapshot.mode not in (Mode.TELEOP, Mode.REPLAY)
        self.making.show(_making(snapshot))
        replay = snapshot.replay
        for control in (self.time, self.play, self._close):
            control.visible = replay is not None
        if replay is not None:
            self._follow(replay)
        self.about.show(_about(snapshot))

    def _bind(self, send: Callable[[Command], None]) -> None:
        @self._open.on_click
        async def _(_: viser.GuiEvent) -> None:
            if (chosen := self._choices.get(self._names.value)) is not None:
                send(chosen)

        @self.time.on_update
        async def _(event: viser.GuiEvent) -> None:
            # The page's own updates come without a client; only a person's drag is a wish.
            if event.client_id is not None:
                send(Seek(float(self.time.value)))

        @self.play.on_click
        async def _(_: viser.GuiEvent) -> None:
            send(Pause())

        @self._close.on_click
        async def _(_: viser.GuiEvent) -> None:
            send(CloseRecording())

    def _list(self, snapshot: Snapshot) -> None:
        names = (*snapshot.recordings, *(IMPORT + name for name in snapshot.sources))
        if names == tuple(self._choices):
            return
        self._choices = {
            **{IMPORT + name: ImportDrive(name) for name in snapshot.sources},
            **{name: OpenRecording(name) for name in snapshot.recordings},
        }
        self._choices = {name: self._choices[name] for name in names}
        chosen = self._names.value
        self._names.options = names or (NONE_YET,)
        if chosen in self._choices:
            self._names.value = chosen
        self._names.disabled = not names

    def _follow(self, replay: PlaybackStatus) -> None:
        if replay.name != self._opened:
            self._opened = self._to_choose = replay.name
            self.time.max = max(replay.length_s, STEP_S)
        if self._to_choose in self._choices:  # A new recording is listed a little later than it is opened.
            self._names.value, self._to_choose = self._to_choose, ""
        if replay.time_s != self._followed:
            # Only a place in time that is new may move the slider, else it would jump back under a person's drag.
            self._followed = replay.time_s
            self.time.value = min(round(replay.time_s / STEP_S) * STEP_S, self.time.max)
        self.play.label = "Pause" if replay.playing else "Play"


def _making(snapshot: Snapshot) -> str:
    if not snapshot.is_making:
        return ""
    hint = "leave nothing behind"
    return button_row(
        ActionButton(Action.CANCEL, "Cancel", "Esc", hint, is_enabled=snapshot.mode in (Mode.TELEOP, Mode.REPLAY))
    )


def _about(snapshot: Snapshot) -> str:
    if snapshot.replay is None:
        return ""
    moment = snapshot.moment
    return note(
        f"{snapshot.replay.name}: {snapshot.replay.time_s:.1f} of {snapshot.replay.length_s:.1f} s, "
        f"{moment.frames} images, {len(moment.graph.ids)} nodes, {len(moment.graph.p)} edges."
    )
