"""The “Drive” tab: recording, mapping, fine-tuning and the pad.

The page's script draws the pad (`static/pad.js`).
"""

import json
from collections.abc import Callable

import viser

from ltvn_viz.panels.html_widgets import (
    ActionButton,
    HtmlBlock,
    button_row,
    lines,
    note,
    number_grid,
    progress_bar,
    warning,
    with_keys,
)
from ltvn_viz.session.fine_tuning import besides_words
from ltvn_viz.session.snapshot import FineTuningPhase, FineTuningStatus, Snapshot
from ltvn_viz.wishes.modes import Mode
from ltvn_viz.wishes.wish_table import LEAST_MINUTES, MOST_MINUTES, Action


class DrivePanel:
    """Recording and mapping while a person drives."""

    def __init__(self, gui: viser.GuiApi) -> None:
        """Add the controls to the tab that is open."""
        about = with_keys(
            "Drive with W A S D held; the map grows as you go. A recording contains everything that happens."
        )
        HtmlBlock(gui, f'<div class="lt lt-note">{about}</div>')
        self.recording = HtmlBlock(gui)
        self.map = HtmlBlock(gui)
        self.played = HtmlBlock(gui)
        self.counts = HtmlBlock(gui)

    def show(self, snapshot: Snapshot) -> None:
        """Enable the controls that are possible now, and show the size of the map."""
        recording = snapshot.recording.name is not None
        self.recording.show(
            button_row(
                ActionButton(Action.RECORD, is_main=not recording, is_enabled=not recording),
                ActionButton(Action.KEEP, is_main=True, is_enabled=recording),
                ActionButton(Action.DISCARD, is_enabled=recording),
                mode=snapshot.mode,
            )
        )
        recorded = snapshot.mode is Mode.REPLAY
        ready = not (recorded and snapshot.is_making)
        whence = "all images of this recording, into a new file" if recorded else "all available images"
        label = "" if recorded else "Rebuild the map"
        build = ActionButton(Action.BUILD, label, hint=f"from {whence}", is_enabled=ready)
        cancel = ActionButton(Action.CANCEL, hint="stop building; the old map stays")
        undo = ActionButton(Action.UNDO_BUILD)
        is_building = snapshot.mode is Mode.BUILDING
        beside = (cancel,) if is_building else (undo,) if snapshot.can_undo_build and not recorded else ()
        self.map.show(button_row(build, *beside, mode=snapshot.mode))
        play = button_row(ActionButton(Action.PLAY_DRIVE), mode=snapshot.mode)
        self.played.show(play if snapshot.drive_is_over is not None else "")
        self.counts.show(_counts(snapshot))


def _counts(snapshot: Snapshot) -> str:
    moment = snapshot.moment
    progress = moment.progress
    return number_grid(
        (f"{moment.frames:,}", "images of this drive"),
        (f"{len(moment.graph.ids):,}", "nodes"),
        (f"{len(moment.graph.p):,}", "edges"),
        (f"{progress.collisions}", "collisions"),
        (f"{progress.queries}", "queries"),
        (f"{progress.reached}", "arrived"),
        (f"{progress.added:,}", "edges added on the way"),
        (f"{progress.pruned:,}", "edges pruned on the way"),
    )


class PadPanel:
    """Sends the current activity and goal to all pages."""

    def __init__(self, tell: Callable[[str], None]) -> None:
        """Send messages by `tell`, which returns at once."""
        self._tell = tell
        self._told = ""

    def show(self, snapshot: Snapshot) -> None:
        """Send the activity if it changed."""
        message = _activity_message(snapshot)
        if message != self._told:
            self._told = message
            self._tell(message)


def _activity_message(snapshot: Snapshot) -> str:
    """Return a message with the mode, the node that the robot drives to, and whether a story is running."""
    goal = None if snapshot.destination is None else int(snapshot.destination)
    return json.dumps(
        {
            "type": "activity",
            "mode": snapshot.mode,
            "goal": goal,
            "story": snapshot.story_goes_on,
            "openLoop": snapshot.is_open_loop,
        }
    )


MINUTES = 3
_ADVANCED = '<button type="button" class="lt-words" data-ltvn-toggle="advanced">Advanced: the 3D scene</button>'


class FineTuningPanel:
    """Buttons to start and stop fine-tuning and to use the new weights."""

    def __init__(self, gui: viser.GuiApi) -> None:
        """Add the controls to the tab that is open."""
        self.about = HtmlBlock(gui)
        self.state = HtmlBlock(gui)
        self.minutes = gui.add_number(
            "Minutes",
            MINUTES,
            min=LEAST_MINUTES,
            max=MOST_MINUTES,
            step=1,
            hint="time for training; preparation and evaluation take additional time",
        )
        self.buttons = HtmlBlock(gui)
        HtmlBlock(gui, _ADVANCED)

    def show(self, snapshot: Snapshot) -> None:
        """Show the drive to learn from, the progress, or the result."""
        fine_tuning = snapshot.fine_tuning
        possible = fine_tuning.is_possible
        self.about.show(note(_about(fine_tuning, snapshot.weights)))
        self.state.show(_state(fine_tuning))
        asks = possible and fine_tuning.phase not in (FineTuningPhase.LEARNING, FineTuningPhase.LEARNED)
        if self.minutes.visible != asks:
            self.minutes.visible = asks
        self.buttons.show(_buttons(snapshot, round(self.minutes.value)) if possible else "")


def _about(fine_tuning: FineTuningStatus, weights: str) -> str:
    if not fine_tuning.is_possible:
        return f"Images are compared by {weights}; here only the network learns. Train others with `ltvn finetune`."
    if fine_tuning.phase is FineTuningPhase.LEARNING:
        return f"The network learns from {fine_tuning.drive}; drive on meanwhile."
    if fine_tuning.phase is FineTuningPhase.LEARNED:
        return "The network learned. The map still uses the network as it was."
    return f"The network can learn this place from {fine_tuning.drive}. {besides_words(fine_tuning.besides_s)}"


def _state(fine_tuning: FineTuningStatus) -> str:
    match fine_tuning.phase:
        case FineTuningPhase.LEARNING:
            return progress_bar(fine_tuning.share, fine_tuning.doing) + (
                note(fine_tuning.left) if fine_tuning.left else ""
            )
        case FineTuningPhase.LEARNED:
            return lines(*fine_tuning.lines, f"Saved in {fine_tuning.path}.")
        case FineTuningPhase.WORSE:
            worse = "It now accepts more far pairs as near, so the old weights stay in use."
            return lines(*fine_tuning.lines) + warning(worse, f"The new ones are in {fine_tuning.path}.")
        case FineTuningPhase.FAILED:
            return warning(*fine_tuning.lines)
        case FineTuningPhase.IDLE:
            return lines(*fine_tuning.lines)


def _buttons(snapshot: Snapshot, minutes: int) -> str:
    match snapshot.fine_tuning.phase:
        case FineTuningPhase.LEARNING:
            return button_row(ActionButton(Action.STOP_LEARNING))
        case FineTuningPhase.LEARNED:
            ready = snapshot.mode is Mode.TELEOP and snapshot.recording.name is None
            hint = "" if ready else "while driving, when nothing is being recorded"
            return button_row(
                ActionButton(Action.USE_WEIGHTS, hint=hint, is_main=ready, is_enabled=ready),
                ActionButton(Action.LEAVE_WEIGHTS),
            )
        case FineTuningPhase.IDLE | FineTuningPhase.WORSE | FineTuningPhase.FAILED:
            return button_row(ActionButton(Action.LEARN, target=minutes))
