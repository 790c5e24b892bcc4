"""Fine-tuning: weights get to know the place of one drive, for whoever asks (section IV of the paper).

Owns the order of the parts, one progress over all of them, cancelling, and what is on disk afterwards: the new weights
with their card, whole, or nothing. The command line, the page and the evaluation all call `fine_tune`.
"""

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from shutil import rmtree
from tempfile import TemporaryDirectory
from threading import Event
from typing import TYPE_CHECKING, Any, Protocol, cast

from ltvn_core.errors import WeightsError
from ltvn_core.training.fine_tuning_data import RehearsalData

if TYPE_CHECKING:
    from ltvn_core.network.optimization.fine_tuning_loop import (
        FineTuningData,
        FineTuningMetrics,
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


class FineTuningReporter(Protocol):
    """Hears how far a fine-tuning is; what it raises ends the work."""

    def __call__(self, share: float, doing: str, progress: "FineTuningProgress | None", /) -> None:
        """Take the share that is done, in [0, 1], what is being done, for a person, and while learning the steps."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class FineTuningProvenance:
    """What the card says of a fine-tuning beside what the run itself knows."""

    recording: str
    """Name of the drive."""
    system: str
    """The navigation system whose labels are learned, see `ltvn_core.systems.registry`."""
    command: str | None = None
    """The command line that makes these weights again; None where there is none."""


@dataclass(frozen=True)
class FineTuningCard:
    """The model card of fine-tuned weights; it contains the card of their parent."""

    parent: str
    """Fingerprint of the weights that fine-tuning started from."""
    parent_card: Mapping[str, Any]
    """Their card."""
    recording: str
    """Name of the recording of the drive."""
    run: Mapping[str, Any]
    """The settings that identify this run; an equal run is not repeated."""
    command: str | None
    """What makes these weights again, up to the time that learning took elsewhere; None where no command line does."""
    seed: int
    images: int
    """Number of images of the drive that were used."""
    pieces: int
    """Number of pieces between jumps of the drive's odometry."""
    simulated_scenes: tuple[str, ...]
    """Simulated scenes in the batches, against forgetting."""
    validation_scenes: tuple[str, ...]
    """Scenes of the simulated metrics and of the calibration."""
    plan: "FineTuningPlan"
    steps: int
    pairs_compared: int
    minutes: float
    before: "FineTuningMetrics | None"
    """None if the run was not evaluated."""
    after: "FineTuningMetrics | None"


@dataclass(frozen=True)
class FineTunedWeights:
    """New weights, and figures before and after."""

    weights: Path
    fingerprint: str
    parent: str
    """Fingerprint of the weights it started from."""
    images: int
    """Images of the drive that were used."""
    pieces: int
    """Pieces of the drive between jumps of its odometry; 1 is what one wants."""
    steps: int
    minutes: float
    before: dict[str, float]
    """On the own drive by odometry, and in simulated scenes that are not learned from."""
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
) -> FineTunedWeights | None:
    """Fine-tune weights on a labelled drive and save them with a card; None, and nothing on disk, if cancelled.

    Args:
        drive: the labelled pairs of the drive.
        rehearsal: what is shown in between, so that nothing is forgotten.
        start: the weights to start from, which stay as they are.
        output: the weights to write. Weights of the very same run are returned and not made again.
        plan: how to learn.
        provenance: what the card says of it.
        work_folder: holds a checkpoint meanwhile: a call that was killed goes on from there. None takes a temporary
            folder beside the output.
        on_progress: is called in this thread; what it raises ends the work.
        cancelled: when it is set, the work ends at its next report of progress.

    Raises:
        WeightsError: if `output` is something else, which is never overwritten, if `start` cannot be read, or if the
            disk does not take the result.
        DatasetError: if the rehearsal data cannot be had.
    """
    from ltvn_core.network.optimization.fine_tuning_loop import run_fine_tuning

    run = _run_identity(drive, rehearsal, start, plan, provenance)
    if (done := _finished_earlier(output, run)) is not None:
        return done
    progress = _Progress(on_progress or _report_to_nobody, cancelled or Event())
    try:
        with _work_folder(work_folder, output) as folder:
            data = rehearsal.load(drive, progress.rehearsing, with_validation_drives=plan.judge)
            result = run_fine_tuning(
                data, start, plan, folder, on_progress=progress.learning, cancelled=progress.cancelled
            )
            if result is None:
                raise _CancelledError
            _save(result, output, _card(result, data, plan, start, run, provenance))
    except _CancelledError:
        return None
    except OSError as error:
        raise WeightsError(f"Learning ended without a result ({error}); free some space and try again.") from error
    return _summary(output)


class _CancelledError(Exception):
    """Somebody cancelled."""


class _Progress:
    """One progress over all parts; a part that reports after cancelling ends there."""

    def __init__(self, on_progress: FineTuningReporter, cancelled: Event) -> None:
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
        self._on_progress(share, doing, progress)


def _report_to_nobody(share: float, doing: str, progress: "FineTuningProgress | None") -> None:
    """Report progress to nobody."""


@contextmanager
def _work_folder(folder: Path | None, output: Path) -> Iterator[Path]:
    """Yield a folder for checkpoints, gone once the work is over or cancelled; a named one outlives other ends."""
    if folder is None:
        # Made beside the output, so that a folder that cannot be written is found out before minutes of learning.
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
    """Return what tells this run from others, as JSON holds it."""
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


def _finished_earlier(output: Path, run: Mapping[str, Any]) -> FineTunedWeights | None:
    """Return the output if it is of this very run, None if there is none. Raises WeightsError if it is another's."""
    from ltvn_core.network.weights_file import matching_card

    if not output.exists():
        return None
    made_by = matching_card(output).get("run", {})
    # Earlier versions wrote fewer keys, those of the evaluation with the plan; what they wrote must agree.
    if (
        not isinstance(made_by, dict)
        or "plan" not in made_by
        or any(made_by[key] != run[key] for key in made_by.keys() & run.keys())
    ):
        raise WeightsError(
            f"{output} exists and was made otherwise; nothing is overwritten. Name another output, or move that away."
        )
    return _summary(output)


def _card(
    result: "FineTuningResult",
    data: "FineTuningData",
    plan: "FineTuningPlan",
    start: Path,
    run: Mapping[str, Any],
    provenance: FineTuningProvenance,
) -> dict[str, Any]:
    from ltvn_core.network.weights_file import read_card

    drive = cast("TrajectoryPairs", data.drive)
    card = FineTuningCard(
        parent=result.parent,
        parent_card=read_card(start),
        recording=provenance.recording,
        run=run,
        command=provenance.command,
        seed=plan.learning.seed,
        images=len(drive.poses),
        pieces=drive.trajectory.pieces,
        simulated_scenes=tuple(scene.name for scene in data.scenes),
        validation_scenes=tuple(scene.name for scene in data.validation),
        plan=plan,
        steps=result.steps,
        pairs_compared=result.pairs,
        minutes=result.seconds / 60,
        before=result.before,
        after=result.after,
    )
    return asdict(card)


def _save(result: "FineTuningResult", output: Path, card: Mapping[str, Any]) -> None:
    from ltvn_core.network.weights_file import save_weights

    save_weights(result.network, output, card)


def _summary(weights: Path) -> FineTunedWeights:
    """Read back what the card says."""
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
            "another output, or move the weights and their card away and learn again."
        ) from error


def _flat_metrics(metrics: Mapping[str, Any] | None) -> dict[str, float]:
    """Return the most important metrics of a `FineTuningMetrics` in a card, by name; empty for None."""
    if metrics is None:
        return {}
    own = metrics["own"]
    found = _named("own", own["pairs"], _PAIR_METRICS) | _named("own", own["far"], _FAR_METRICS)
    found |= _named("simulated", metrics["simulated"], _PAIR_METRICS)
    return found | _named("simulated", metrics["simulated_drives"] or {}, _FAR_METRICS)


def _named(where: str, figures: Mapping[str, float], names: tuple[str, ...]) -> dict[str, float]:
    return {f"{where}_{name}": figures[name] for name in names if name in figures}
