"""What a person asks of learning: which drive is learned from, and how new weights come into use.

Runs in the session's thread. How a lesson goes is `learning`.
"""

from collections.abc import Callable, Sequence
from datetime import datetime

from ltvn_core.errors import OptionError, RecordingError
from ltvn_core.graph.deltas import GraphDelta
from ltvn_core.nav.events import Severity
from ltvn_core.types import Observation
from ltvn_core.verbs.tuning import DriveAtHand
from ltvn_viz.building import Building
from ltvn_viz.replay import Replay
from ltvn_viz.stage import Stage

LEAST_MINUTES, MOST_MINUTES = 1, 60
AT_HAND = "images-at-hand"
"""What the card of weights calls a drive that is no recording."""


def drive_name(stage: Stage) -> str:
    """Return which drive is learned from: the open recording, else the last kept one, else the images of the map."""
    return _recording(stage) or f"the {len(stage.mapping.views):,} images of the map"


def learn(stage: Stage, minutes: float) -> None:
    """Begin a lesson; raises OptionError and RecordingError."""
    stage.learning.require_free()
    if not LEAST_MINUTES <= minutes <= MOST_MINUTES:
        raise OptionError(f"Learning takes {LEAST_MINUTES} to {MOST_MINUTES} minutes, not {minutes:g}.")
    name = _recording(stage)
    output = stage.library.new_weights(name or AT_HAND, datetime.now())
    if name is not None:
        stage.learning.begin(DriveAtHand(name, stage.library.path(name)), output, minutes)
        return

    def begin(images: Sequence[Observation]) -> None:
        try:
            stage.learning.begin(DriveAtHand(AT_HAND, images), output, minutes)
        except OptionError as error:  # Somebody pressed twice.
            stage.say(str(error), Severity.WARN)

    stage.worker.submit(stage.mapping.images, begin)


def use_weights(stage: Stage) -> None:
    """Build the map anew with the new weights and use them from then on; raises OptionError and RecordingError."""
    weights = stage.learning.offer
    if stage.live.recorder.is_on:
        raise RecordingError(
            "A recording holds a map of one set of weights. Keep this recording (N) or discard it, then use the new "
            "ones."
        )

    def rebuild(progress: Callable[[int, int], None]) -> Sequence[GraphDelta]:
        return stage.mapping.rebuild_with(*stage.open_mind(weights), progress)

    def then() -> None:
        stage.learning.used(weights)
        stage.say(
            f"The map was built anew with the weights {stage.mapping.fingerprint}. Start the app with --weights "
            f"{weights} to use them another time."
        )

    stage.activity = Building(stage.live, stage.worker, rebuild, then)


def _recording(stage: Stage) -> str | None:
    return stage.activity.name if isinstance(stage.activity, Replay) else stage.kept
