"""The lower half of the “Drive” tab: the network learns from a drive, and its new weights come into use."""

import viser

from ltvn_viz.panels.html_widgets import ActionButton, HtmlBlock, button_row, lines, note, progress_bar, warning
from ltvn_viz.server.keymap import Action
from ltvn_viz.session.commands import LEAST_MINUTES, MOST_MINUTES
from ltvn_viz.session.learning_time import besides_words
from ltvn_viz.session.modes import Mode
from ltvn_viz.session.snapshot import FineTuningPhase, FineTuningStatus, Snapshot

MINUTES = 3


class FineTuningPanel:
    """One button to begin, one to stop, and one to use what came of it."""

    def __init__(self, gui: viser.GuiApi) -> None:
        """Add the controls to the tab that is open."""
        self.about, self.state = HtmlBlock(gui), HtmlBlock(gui)
        self.minutes = gui.add_number(
            "Minutes",
            MINUTES,
            min=LEAST_MINUTES,
            max=MOST_MINUTES,
            step=1,
            hint="how long to learn; preparing and judging come on top",
        )
        self.buttons = HtmlBlock(gui)

    def show(self, snapshot: Snapshot) -> None:
        """Show what would be learned from, what is being done, or what came of it."""
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
        return f"Images are compared by {weights}; here only the network learns. Others may learn by `ltvn finetune`."
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
            worse = "It now takes more places that are far apart for near, so the old weights stay in use."
            return lines(*fine_tuning.lines) + warning(worse, f"The new ones are in {fine_tuning.path}.")
        case FineTuningPhase.FAILED:
            return warning(*fine_tuning.lines)
        case FineTuningPhase.IDLE:
            return lines(*fine_tuning.lines)


def _buttons(snapshot: Snapshot, minutes: int) -> str:
    match snapshot.fine_tuning.phase:
        case FineTuningPhase.LEARNING:
            return button_row(ActionButton(Action.STOP_LEARNING, "Stop learning", hint="the network stays as it is"))
        case FineTuningPhase.LEARNED:
            ready = snapshot.mode is Mode.TELEOP and snapshot.recording.name is None
            hint = "while driving, when nothing is being recorded" if not ready else "takes about as long as building"
            return button_row(
                ActionButton(
                    Action.USE_WEIGHTS, "Use these weights and rebuild the map", "", hint, ready, is_enabled=ready
                ),
                ActionButton(
                    Action.LEAVE_WEIGHTS, "Not now", hint="go on with the weights in use; the new ones stay on disk"
                ),
            )
        case FineTuningPhase.IDLE | FineTuningPhase.WORSE | FineTuningPhase.FAILED:
            hint = "fine-tune the network on these images; nothing changes before you say so"
            return button_row(ActionButton(Action.LEARN, "Learn from this drive", hint=hint, target=minutes))
