"""Fine-tuning: adapts weights to the environment of one drive (section IV of the paper).

Owns the order of the steps, one progress over all of them, cancelling, and the output: complete new weights with their
card, or no file. The command line, the page and the evaluation all call `fine_tune`.
"""

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from shutil import rmtree
from tempfile import TemporaryDirectory
from threading import Event
from typing import TYPE_CHECKING, Any, TypeAlias, cast

from ltvn_core.errors import WeightsError
from ltvn_core.training.fine_tuning_data import RehearsalData

if TYPE_CHECKING:
    from ltvn_core.network.optimization.fine_tuning_loop import (
        FineTuningData,
        FineTuningPlan,
        FineTuningProgress,
        FineTuningResult,
    )
    from ltvn_core.network.training_data.trajectory_pairs import TrajectoryPairs

_REHEARSAL_LOADED = 0.18
"""Progress, in [0, 1], when the rehearsal data are loaded."""
_LEARNED = 0.92
"""Progress, in [0, 1], when learning ends; the rest is validation."""


_PAIR_METRICS = ("auc", "position_median_m", "position_p90_m", "yaw_median_deg", "ece")
_FAR_METRICS = ("far_pairs", "far_fpr_at_tpr60", "far_fpr_at_half", "near_tpr_at_half")


FineTuningReporter: TypeAlias = Callable[[float, str, "FineTuningProgress | None"], object]
"""Called with the share done in [0, 1], the current activity as text and, while learning, its progress."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FineTuningProvenance:
    """Facts for the card of fine-tuned weights that the training itself does not know."""

    recording: str
    """Name of the drive."""
    system: str
    """Name of the navigation system whose labels are learned; see `ltvn_core.systems.registry`."""
    command: str | None = None
    """Command line that reproduces these weights; None if there is none."""


@dataclass(frozen=True)
class FineTunedWeights:
    """Fine-tuned weights, with metrics before and after."""

    weights: Path
    fingerprint: str
    parent: str
    """Fingerprint of the weights from which fine-tuning started."""
    images: int
    """Number of images of the drive that were used."""
    pieces: int
    """Number of pieces of the drive; jumps of its odometry separate them, so 1 is ideal."""
    steps: int
    minutes: float
    before: dict[str, float]
    """Metrics before fine-tuning, on the robot's own drive (labelled by odometry) and in simulated validation
    scenes."""
    after: dict[str, float]


def fine_tune(
    drive: "TrajectoryPairs",
    rehearsal: RehearsalData,
    start: Path,
    output: Path,
    plan: "FineTuningPlan",
    *,
    provenance: FineTuningProvenance,
    work_folder: Path | None = None,
    on_progress: FineTuningReporter | None = None,
    cancelled: Event | None = None,
    device: str = "cpu",
) -> FineTunedWeights | None:
    """Fine-tune weights on a labelled drive and save them with a card; None, and nothing on disk, if cancelled.

    Args:
        drive: Labelled pairs of the drive.
        rehearsal: Data of other places that prevent forgetting.
        start: Weights to start from; the file is not changed.
        output: File of the new weights. Existing weights of the same run are returned without training.
        plan: Settings of fine-tuning.
        provenance: Further facts for the card.
        work_folder: Folder for a checkpoint, from which a call that was killed is resumed. None uses a temporary folder
            beside the output.
        on_progress: Called in this thread; an exception in it stops the work.
        cancelled: Event that stops the work at its next report of progress.
        device: Where the network learns: `cpu`, `cuda`, `mps`, or `auto` for the fastest one.

    Raises:
        WeightsError: `output` exists and is something else, which is never overwritten; `start` cannot be read; or the
            result cannot be written.
        DatasetError: The rehearsal data are missing and cannot be made.
    """
    from ltvn_core.network.device import choose_device
    from ltvn_core.network.optimization.fine_tuning_loop import run_fine_tuning
    from ltvn_core.network.weights_file import matching_card, save_weights

    run = _run_identity(drive, rehearsal, start, plan, provenance)
    if output.exists():
        if matching_card(output).get("run") != run:
            raise WeightsError(
                f"{output} exists, was made with other settings, and is not overwritten. Name another output, or move "
                "that file."
            )
        return _summary(output)
    progress = _Progress(on_progress, cancelled or Event())
    try:
        with _work_folder(work_folder, output) as folder:
            data = rehearsal.load(drive, progress.rehearsing, with_validation_drives=plan.judge)
            result = run_fine_tuning(
                data, start, plan, folder, on_progress=progress.learning, device=choose_device(device)
            )
            save_weights(result.network, output, _card(result, data, plan, start, run, provenance))
    except _CancelledError:
        return None
    except OSError as error:
        raise WeightsError(f"Training ended without a result ({error}); free some space and try again.") from error
    return _summary(output)


class _CancelledError(Exception):
    """The user cancelled the run."""


class _Progress:
    """Progress over all steps; the first report after cancelling stops the work."""

    def __init__(self, on_progress: FineTuningReporter | None, cancelled: Event) -> None:
        self.cancelled = cancelled
        self._on_progress = on_progress

    def rehearsing(self, share: float, doing: str) -> None:
        self._report(_REHEARSAL_LOADED * share, doing, None)

    def learning(self, progress: "FineTuningProgress") -> None:
        is_after = progress.doing == "judging the weights after"
        end = _LEARNED + is_after * (1 - _LEARNED) / 2
        share = _REHEARSAL_LOADED + (end - _REHEARSAL_LOADED) * progress.share
        self._report(share, progress.doing, progress)

    def _report(self, share: float, doing: str, progress: "FineTuningProgress | None") -> None:
        if self.cancelled.is_set():
            raise _CancelledError
        if self._on_progress is not None:
            self._on_progress(share, doing, progress)


@contextmanager
def _work_folder(folder: Path | None, output: Path) -> Iterator[Path]:
    """Yield a folder for checkpoints, which is deleted when the work is done or cancelled; a named folder survives
    errors."""
    if folder is None:
        # Created beside the output, so that a missing write permission shows before minutes of learning.
        with TemporaryDirectory(prefix=".learning-", dir=output.parent, ignore_cleanup_errors=True) as temporary:
            yield Path(temporary)
        return
    folder.mkdir(parents=True, exist_ok=True)
    try:
        yield folder
    except _CancelledError:
        rmtree(folder, ignore_errors=True)
        raise
    rmtree(folder, ignore_errors=True)


def _run_identity(
    drive: "TrajectoryPairs",
    rehearsal: RehearsalData,
    start: Path,
    plan: "FineTuningPlan",
    provenance: FineTuningProvenance,
) -> dict[str, Any]:
    """Return the settings that identify this run, as JSON values."""
    from ltvn_core.network.optimization.fine_tuning_loop import trajectory_fingerprint
    from ltvn_core.network.weights_file import weights_fingerprint

    run = {
        "system": provenance.system,
        "labels": asdict(cast(Any, drive.rule)),
        "parent": weights_fingerprint(start),
        "drive": trajectory_fingerprint(drive),
        "rehearsal": rehearsal.name,
        "simulated": list(rehearsal.scenes),
        "plan": asdict(plan),
    }
    return json.loads(json.dumps(run))


def _card(
    result: "FineTuningResult",
    data: "FineTuningData",
    plan: "FineTuningPlan",
    start: Path,
    run: Mapping[str, Any],
    provenance: FineTuningProvenance,
) -> dict[str, Any]:
    """Return the model card; it contains the card of the parent, and the run, which is not repeated."""
    from ltvn_core.network.weights_file import read_card

    return {
        "parent": result.parent,
        "parent_card": read_card(start),
        "recording": provenance.recording,
        "run": run,
        "command": provenance.command,
        "seed": plan.learning.seed,
        "images": len(data.drive.poses),
        "pieces": data.drive.pieces,
        "simulated_scenes": [scene.name for scene in data.scenes],
        "validation_scenes": [scene.name for scene in data.validation],
        "plan": asdict(plan),
        "steps": result.steps,
        "pairs_compared": result.pairs,
        "minutes": result.seconds / 60,
        "before": result.before and asdict(result.before),
        "after": result.after and asdict(result.after),
    }


def _summary(weights: Path) -> FineTunedWeights:
    """Return the summary of fine-tuned weights, from their card."""
    from ltvn_core.network.weights_file import read_card

    card = read_card(weights)
    try:
        return FineTunedWeights(
            weights=weights,
            fingerprint=card["fingerprint"],
            parent=card["parent"],
            images=card["images"],
            pieces=card["pieces"],
            steps=card["steps"],
            minutes=card["minutes"],
            before=_flat_metrics(card["before"]),
            after=_flat_metrics(card["after"]),
        )
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise WeightsError(
            f"{weights}: the card beside these weights does not fit them ({type(error).__name__}: {error}); name "
            "another output, or move the weights and their card away and train again."
        ) from error


def _flat_metrics(metrics: Mapping[str, Any] | None) -> dict[str, float]:
    """Return the most important metrics of the `FineTuningMetrics` in a card, by name; empty for None."""
    if metrics is None:
        return {}
    parts = (
        ("own", metrics["own"]["pairs"], _PAIR_METRICS),
        ("own", metrics["own"]["far"], _FAR_METRICS),
        ("simulated", metrics["simulated"], _PAIR_METRICS),
        ("simulated", metrics["simulated_drives"] or {}, _FAR_METRICS),
    )
    return {f"{of}_{name}": figures[name] for of, figures, names in parts for name in names if name in figures}
