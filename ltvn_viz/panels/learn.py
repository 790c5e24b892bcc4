"""The lower half of the “Drive” tab: the network learns from a drive, and its new weights come into use."""

import viser

from ltvn_viz.keymap import Action
from ltvn_viz.lessons import LEAST_MINUTES, MOST_MINUTES
from ltvn_viz.modes import Mode
from ltvn_viz.panels.markup import Markup, Press, buttons, lines, note, progress_bar, warning
from ltvn_viz.snapshot import LearningStatus, Phase, Snapshot

MINUTES = 3


class LearnPanel:
    """One button to begin, one to stop, and one to use what came of it."""

    def __init__(self, gui: viser.GuiApi) -> None:
        """Add the controls to the tab that is open."""
        self._about, self._state = Markup(gui), Markup(gui)
        self._minutes = gui.add_number(
            "Minutes",
            MINUTES,
            min=LEAST_MINUTES,
            max=MOST_MINUTES,
            step=1,
            hint="how long to learn, beside a minute or so for judging",
        )
        self._buttons = Markup(gui)

    def show(self, snapshot: Snapshot) -> None:
        """Show what would be learned from, what is being done, or what came of it."""
        learning = snapshot.learning
        self._about.show(note(_about(learning, snapshot.weights)))
        self._state.show(_state(learning))
        asks = learning.phase not in (Phase.LEARNING, Phase.LEARNED)
        if self._minutes.visible != asks:
            self._minutes.visible = asks
        self._buttons.show(_buttons(snapshot, round(self._minutes.value)))


def _about(learning: LearningStatus, weights: str) -> str:
    if learning.phase is Phase.LEARNING:
        return f"The network learns from {learning.drive}; drive on meanwhile."
    if learning.phase is Phase.LEARNED:
        return f"The network learned. The map still uses the weights {weights}."
    return f"The network (weights {weights}) can learn this place from {learning.drive}."


def _state(learning: LearningStatus) -> str:
    match learning.phase:
        case Phase.LEARNING:
            return progress_bar(learning.share, learning.doing)
        case Phase.LEARNED:
            return lines(*learning.lines, f"Saved in {learning.path}.")
        case Phase.WORSE:
            worse = "It now takes more places that are far apart for near, so the old weights stay in use."
            return lines(*learning.lines) + warning(worse, f"The new ones are in {learning.path}.")
        case Phase.FAILED:
            return warning(*learning.lines)
    return lines(*learning.lines)


def _buttons(snapshot: Snapshot, minutes: int) -> str:
    match snapshot.learning.phase:
        case Phase.LEARNING:
            return buttons(Press(Action.STOP_LEARNING, "Stop learning", hint="the network stays as it is"))
        case Phase.LEARNED:
            ready = snapshot.mode is Mode.TELEOP and snapshot.recording.name is None
            hint = "while driving, when nothing is being recorded" if not ready else "takes about as long as building"
            return buttons(
                Press(Action.USE_WEIGHTS, "Use these weights and rebuild the map", "", hint, ready, is_enabled=ready),
                Press(Action.LEAVE_WEIGHTS, "Not now", hint="go on with the weights in use; the new ones stay on disk"),
            )
    hint = "fine-tune the network on these images; nothing changes before you say so"
    return buttons(Press(Action.LEARN, "Learn from this drive", hint=hint, target=minutes))
