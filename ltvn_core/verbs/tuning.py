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
from ltvn_core.lessons.data import Tell, label_drive, read_drive, with_simulation
from ltvn_core.types import Intrinsics, Observation
from ltvn_core.verbs.finetune import Finetune, FineTunedWeights

if TYPE_CHECKING:
    from ltvn_core.data.trajectory_pairs import TrajectoryPairs
    from ltvn_core.model.finetuning import FineTuningData, FineTuningPlan, Progress

Simulate: TypeAlias = Callable[["TrajectoryPairs", Tell], "FineTuningData"]
"""Adds to a drive the simulated pairs that keep a network from unlearning, telling of progress."""

_READ, _SIMULATED, _LEARNED = 0.03, 0.2, 0.92
"""Shares of the bar at which reading, rendering and learning end."""


@dataclass(frozen=True)
class DriveAtHand:
    """What to learn from."""

    name: str
    """What the card calls it."""
    images: Path | Sequence[Observation]
    """A recording, or images in the order in which they were taken."""

    def label(self, *, horizon: int) -> "TrajectoryPairs":
        """Label the drive's pairs by odometry. Raises RecordingError if it is no drive."""
        if isinstance(self.images, Path):
            return read_drive(self.images, horizon=horizon, gated=True)
        from ltvn_core.data.trajectory_pairs import PairRule

        return label_drive(self.images, self.name, camera=Intrinsics(), rule=PairRule(horizon=horizon))


@dataclass(frozen=True)
class Lesson:
    """One fine-tuning that a person asked for."""

    drive: DriveAtHand
    start: Path | None
    """Weights to start from, which stay as they are; None are the shipped ones."""
    output: Path
    """The weights to write, with a card beside them; nothing lies there yet."""
    minutes: float


@dataclass(frozen=True)
class Tuner:
    """Teaches weights a place."""

    plan: "FineTuningPlan | None" = None
    """How to learn, whatever time is asked for; None follows the default plan for the time asked for."""
    simulate: Simulate | None = None
    """None renders a few scenes at the first use and keeps them in the user's cache."""

    def __call__(self, lesson: Lesson, tell: Tell, cancelled: Event) -> FineTunedWeights | None:
        """Fine-tune on a drive and save weights; return None, and leave nothing, if it was cancelled.

        Raises RecordingError, DatasetError and WeightsError.
        """
        try:
            return self._tune(lesson, _Bar(tell, cancelled), cancelled)
        except _GivenUpError:
            return None
        except OSError as error:
            raise WeightsError(f"Learning ended without a result ({error}); free some space and try again.") from error

    def _tune(self, lesson: Lesson, bar: "_Bar", cancelled: Event) -> FineTunedWeights | None:
        name = Path(lesson.drive.name)
        verb = Finetune(recording=name, output=lesson.output, weights=lesson.start, minutes=lesson.minutes)
        bar.reading(0.0, "reading and labelling the drive")
        pairs = lesson.drive.label(horizon=verb.horizon)
        # Made beside the output, so that a folder that cannot be written is found out before minutes of learning.
        with TemporaryDirectory(prefix=".learning-", dir=lesson.output.parent, ignore_cleanup_errors=True) as folder:
            simulate = self.simulate or (lambda drive, tell: with_simulation(drive, None, tell))
            data = simulate(pairs, bar.simulating)
            plan = self.plan or verb.plan()
            return verb.learn(data, plan, Path(folder), on_progress=bar.learning, cancelled=cancelled)


class _GivenUpError(Exception):
    """A person cancelled."""


class _Bar:
    """One bar for all parts; a part that tells of progress after cancelling ends there."""

    def __init__(self, tell: Tell, cancelled: Event) -> None:
        self._tell, self._cancelled = tell, cancelled

    def reading(self, share: float, doing: str) -> None:
        self._show(_READ * share, doing)

    def simulating(self, share: float, doing: str) -> None:
        self._show(_READ + (_SIMULATED - _READ) * share, doing)

    def learning(self, progress: "Progress") -> None:
        is_after = progress.doing == "judging the weights after"
        end = _LEARNED + is_after * (1 - _LEARNED) / 2
        self._show(_SIMULATED + (end - _SIMULATED) * progress.share, progress.doing)

    def _show(self, share: float, doing: str) -> None:
        if self._cancelled.is_set():
            raise _GivenUpError
        self._tell(share, doing)
