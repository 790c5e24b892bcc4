"""Fine-tuning for a program that goes on meanwhile: with progress from beginning to end, and a way to give up.

Owns the order of the parts and how they share one bar. The parts are those of `ltvn finetune`; the page calls this.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Event
from typing import TYPE_CHECKING, TypeAlias

from ltvn_core.errors import WeightsError
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.training.fine_tuning_data import ProgressReporter, add_simulated_pairs, label_drive, read_labelled_drive
from ltvn_core.types import Observation
from ltvn_core.verbs.finetune import FineTunedWeights, FinetuneVerb

if TYPE_CHECKING:
    from ltvn_core.network.optimization.fine_tuning_loop import FineTuningData, FineTuningPlan, FineTuningProgress
    from ltvn_core.training_data.trajectory_pairs import TrajectoryPairs

AddSimulatedPairs: TypeAlias = Callable[["TrajectoryPairs", ProgressReporter], "FineTuningData"]
"""Adds to a drive the simulated pairs that keep a network from unlearning, telling of progress."""

_READ, _SIMULATED, _LEARNED = 0.03, 0.2, 0.92
"""Shares of the bar at which reading, rendering and learning end."""


@dataclass(frozen=True)
class DriveSource:
    """What to learn from."""

    name: str
    """What the card calls it."""
    images: Path | Sequence[Observation]
    """A recording, or images in the order in which they were taken."""

    def label(self, *, horizon: int) -> "TrajectoryPairs":
        """Label the drive's pairs by odometry. Raises RecordingError if it is no drive."""
        if isinstance(self.images, Path):
            return read_labelled_drive(self.images, horizon=horizon, gated=True)
        from ltvn_core.training_data.trajectory_pairs import OdometryLabelRule

        return label_drive(self.images, self.name, camera=LOCOBOT.camera, rule=OdometryLabelRule(horizon=horizon))


@dataclass(frozen=True)
class FineTuningRequest:
    """One fine-tuning that a person asked for."""

    drive: DriveSource
    start: Path | None
    """Weights to start from, which stay as they are; None are the shipped ones."""
    output: Path
    """The weights to write, with a card beside them; nothing lies there yet."""
    minutes: float


@dataclass(frozen=True)
class BackgroundFineTuning:
    """Teaches weights a place."""

    plan: "FineTuningPlan | None" = None
    """How to learn, whatever time is asked for; None follows the default plan for the time asked for."""
    simulate: AddSimulatedPairs | None = None
    """None renders a few scenes at the first use and keeps them in the user's cache."""

    def __call__(
        self, request: FineTuningRequest, on_progress: ProgressReporter, cancelled: Event
    ) -> FineTunedWeights | None:
        """Fine-tune on a drive and save weights; return None, and leave nothing, if it was cancelled.

        Raises RecordingError, DatasetError and WeightsError.
        """
        try:
            return self._tune(request, _OverallProgress(on_progress, cancelled), cancelled)
        except _CancelledError:
            return None
        except OSError as error:
            raise WeightsError(f"Learning ended without a result ({error}); free some space and try again.") from error

    def _tune(self, request: FineTuningRequest, bar: "_OverallProgress", cancelled: Event) -> FineTunedWeights | None:
        name = Path(request.drive.name)
        verb = FinetuneVerb(recording=name, output=request.output, weights=request.start, minutes=request.minutes)
        bar.reading(0.0, "reading and labelling the drive")
        pairs = request.drive.label(horizon=verb.horizon)
        # Made beside the output, so that a folder that cannot be written is found out before minutes of learning.
        with TemporaryDirectory(prefix=".learning-", dir=request.output.parent, ignore_cleanup_errors=True) as folder:
            simulate = self.simulate or (lambda drive, on_progress: add_simulated_pairs(drive, None, on_progress))
            data = simulate(pairs, bar.simulating)
            plan = self.plan or verb.plan()
            return verb.learn(data, plan, Path(folder), on_progress=bar.learning, cancelled=cancelled)


class _CancelledError(Exception):
    """A person cancelled."""


class _OverallProgress:
    """One bar for all parts; a part that tells of progress after cancelling ends there."""

    def __init__(self, on_progress: ProgressReporter, cancelled: Event) -> None:
        self._tell, self._cancelled = on_progress, cancelled

    def reading(self, share: float, doing: str) -> None:
        self._show(_READ * share, doing)

    def simulating(self, share: float, doing: str) -> None:
        self._show(_READ + (_SIMULATED - _READ) * share, doing)

    def learning(self, progress: "FineTuningProgress") -> None:
        is_after = progress.doing == "judging the weights after"
        end = _LEARNED + is_after * (1 - _LEARNED) / 2
        self._show(_SIMULATED + (end - _SIMULATED) * progress.share, progress.doing)

    def _show(self, share: float, doing: str) -> None:
        if self._cancelled.is_set():
            raise _CancelledError
        self._tell(share, doing)
