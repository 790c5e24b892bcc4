"""What a person asks of learning: which drive is learned from, and how new weights come into use.

Runs in the session's thread. How a lesson goes is `fine_tuning`.
"""

from collections.abc import Callable, Sequence
from datetime import datetime

from ltvn_core.errors import OptionError, RecordingError
from ltvn_core.graph.deltas import GraphDelta
from ltvn_core.navigation.events import Severity
from ltvn_core.training.fine_tuning_data import DriveSource
from ltvn_core.types import Observation
from ltvn_viz.session.activities.map_building import MapBuilding
from ltvn_viz.session.activities.playback import Playback
from ltvn_viz.session.app_state import AppState
from ltvn_viz.session.commands import LEAST_MINUTES, MOST_MINUTES

MAP_IMAGES = "images-at-hand"
"""What the card of weights calls a drive that is no recording."""


def drive_name(state: AppState) -> str:
    """Return which drive is learned from: the open recording, else the last kept one, else the images of the map."""
    return _recording(state) or f"the {len(state.live_map.keyframes):,} images of the map"


def start_fine_tuning(state: AppState, minutes: float) -> None:
    """Begin a lesson; raises OptionError and RecordingError."""
    state.fine_tuning.require_free()
    if not LEAST_MINUTES <= minutes <= MOST_MINUTES:
        raise OptionError(f"Learning takes {LEAST_MINUTES} to {MOST_MINUTES} minutes, not {minutes:g}.")
    name = _recording(state)
    output = state.library.new_weights(name or MAP_IMAGES, datetime.now())
    if name is not None:
        state.fine_tuning.begin(DriveSource(name, state.library.path(name)), output, minutes)
        return

    def begin(observations: Sequence[Observation]) -> None:
        try:
            state.fine_tuning.begin(DriveSource(MAP_IMAGES, observations), output, minutes)
        except OptionError as error:  # Somebody pressed twice.
            state.say(str(error), Severity.WARN)

    state.worker.submit(state.live_map.observations, begin)


def use_weights(state: AppState) -> None:
    """Build the map anew with the new weights and use them from then on; raises OptionError and RecordingError."""
    weights = state.fine_tuning.offer
    if state.live.recorder.is_on:
        raise RecordingError(
            "A recording holds a map of one set of weights. Keep this recording (N) or discard it, then use the new "
            "ones."
        )

    def rebuild(progress: Callable[[int, int], None]) -> Sequence[GraphDelta]:
        return state.live_map.rebuild_with(*state.predictor_for(weights), progress)

    def then() -> None:
        state.fine_tuning.adopt(weights)
        state.say(
            f"The map was built anew with the weights {state.live_map.fingerprint}. Start the app with --weights "
            f"{weights} to use them another time."
        )

    state.activity = MapBuilding(state.live, state.worker, rebuild, then, findings=lambda: state.live_map.findings)


def _recording(state: AppState) -> str | None:
    return state.activity.name if isinstance(state.activity, Playback) else state.last_recording
