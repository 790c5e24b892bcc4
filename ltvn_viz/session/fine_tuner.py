"""Fine-tuning from the page, on a drive and for a given time.

Owns the arguments of `ltvn_core.training.fine_tuning.fine_tune`, and the progress of labelling the drive, which comes
first.
"""

from dataclasses import dataclass
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING

from ltvn_core.systems.registry import DEFAULT_SYSTEM, system_entry
from ltvn_core.training.fine_tuning import FineTunedWeights, FineTuningProvenance, fine_tune
from ltvn_core.training.fine_tuning_data import DriveSource, ProgressReporter, RehearsalData, SystemTraining

if TYPE_CHECKING:
    from ltvn_core.network.optimization.fine_tuning_loop import FineTuningPlan, FineTuningProgress

_LABELLED = 0.03
"""Share of the progress at which the drive is labelled."""


@dataclass(frozen=True)
class FineTuningRequest:
    """One requested fine-tuning."""

    drive: DriveSource
    start: Path | None
    """Weights to start from, which stay as they are; None takes those that come with the system."""
    output: Path
    """New file for the weights, with a card beside it."""
    minutes: float


@dataclass(frozen=True)
class FineTuner:
    """Fine-tunes the network of a navigation system."""

    system: str = DEFAULT_SYSTEM
    """Navigation system whose labels are learned."""
    plan: "FineTuningPlan | None" = None
    """Training plan that is used for any requested time; None uses the default plan for the requested time."""
    rehearsal: RehearsalData | None = None
    """Data for rehearsal; None takes the system's default."""
    device: str = "cpu"
    """Where the network learns: cpu, cuda, mps or auto."""

    def __call__(
        self, request: FineTuningRequest, on_progress: ProgressReporter, cancelled: Event
    ) -> FineTunedWeights | None:
        """Fine-tune on a drive and save the weights; if it was cancelled, return None and leave no files.

        Raises RecordingError, DatasetError and WeightsError.
        """

        def report(share: float, doing: str, _progress: "FineTuningProgress | None") -> None:
            on_progress(_LABELLED + (1 - _LABELLED) * share, doing)

        on_progress(0.0, "reading and labelling the drive")
        entry = system_entry(self.system)
        training = SystemTraining(entry.learning)
        return fine_tune(
            request.drive.label(training.label_rule()),
            self.rehearsal or training.rehearsal(),
            request.start or entry.weights,
            request.output,
            training.adapt_plan(self.plan or _plan_for(request.minutes)),
            provenance=FineTuningProvenance(recording=request.drive.name, system=entry.name),
            on_progress=report,
            cancelled=cancelled,
            device=self.device,
        )


def _plan_for(minutes: float) -> "FineTuningPlan":
    from ltvn_core.network.optimization.fine_tuning_loop import FineTuningPlan

    return FineTuningPlan(minutes=minutes)
