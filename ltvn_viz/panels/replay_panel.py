"""The “Replay” tab: open a recording, or import a drive. Through its time one moves by the timeline."""

from collections.abc import Callable

import viser

from ltvn_viz.panels.html_widgets import ActionButton, HtmlBlock, button_row, note
from ltvn_viz.server.keymap import Action
from ltvn_viz.session.commands import CloseRecording, Command, ImportDrive, OpenRecording
from ltvn_viz.session.modes import Mode
from ltvn_viz.session.snapshot import Snapshot

QUIET = (73, 80, 87)
NONE_YET: str = "no recordings yet"
IMPORT = "import: "
"""Marks drives in other formats in the list."""


class ReplayPanel:
    """Choose, open, and go back to the robot."""

    def __init__(self, gui: viser.GuiApi, send: Callable[[Command], None]) -> None:
        """Add the controls to the tab that is open; `send` takes commands and returns at once."""
        HtmlBlock(
            gui, note("Watch a recording in this page: the timeline at the foot plays it and moves through its time.")
        )
        self._names = gui.add_dropdown("Recording", [NONE_YET], disabled=True)
        self._open = gui.add_button("Open", icon=viser.Icon.FOLDER_OPEN, color=QUIET, disabled=True)
        self._close = gui.add_button("Back to the robot", icon=viser.Icon.ARROW_BACK_UP, color=QUIET, visible=False)
        self.about = HtmlBlock(gui)
        self.making = HtmlBlock(gui)
        self._choices: dict[str, Command] = {}
        self._opened = self._to_choose = ""
        self._bind(send)

    def show(self, snapshot: Snapshot) -> None:
        """List the recordings and show where in the open one we are."""
        self._list(snapshot)
        self._open.disabled = not self._choices or snapshot.mode not in (Mode.TELEOP, Mode.REPLAY)
        self.making.show(_making(snapshot))
        replay = snapshot.replay
        self._close.visible = replay is not None
        if replay is not None:
            self._choose(replay.name)
        self.about.show(_about(snapshot))

    def _bind(self, send: Callable[[Command], None]) -> None:
        @self._open.on_click
        async def _(_: viser.GuiEvent) -> None:
            if (chosen := self._choices.get(self._names.value)) is not None:
                send(chosen)

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

    def _choose(self, name: str) -> None:
        if name != self._opened:
            self._opened = self._to_choose = name
        if self._to_choose in self._choices:  # A new recording is listed a little later than it is opened.
            self._names.value, self._to_choose = self._to_choose, ""


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
