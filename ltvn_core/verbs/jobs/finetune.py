"""`ltvn finetune`: adapts weights to the place of one recording (sections III-B and IV of the paper)."""

from dataclasses import replace

from tqdm import tqdm

from ltvn_core.data.recording.drive_part import parse_part
from ltvn_core.network.optimization.fine_tuning_loop import FineTuningPlan, FineTuningProgress
from ltvn_core.network.training_data.trajectory_pairs import OdometryLabelRule
from ltvn_core.sole_writer import sole_user
from ltvn_core.systems.registry import DEFAULT_SYSTEM, system_entry
from ltvn_core.training.fine_tuning import FineTuningProvenance, fine_tune
from ltvn_core.training.fine_tuning_data import SimulatedPairs, read_labelled_drive
from ltvn_core.verbs.finetune import FinetuneVerb
from ltvn_core.verbs.jobs.tune_calibration import check_options, tuning_command
from ltvn_core.verbs.verb import Summary

_SHORT_MINUTES = 0.25
"""Time of training, in minutes, below which weights are evaluated on a fifth of the pairs."""


def finetune_network(options: FinetuneVerb) -> Summary:
    """Fine-tune, evaluate and save; raises OptionError, RecordingError, DatasetError and WeightsError."""
    check_options(options)
    rule = OdometryLabelRule(horizon=options.horizon, gated=not options.literal)
    with sole_user(options.output), _ProgressBar() as bar:
        found = fine_tune(
            read_labelled_drive(options.recording, rule, parse_part(options.part)),
            SimulatedPairs(options.data),
            options.weights or system_entry(DEFAULT_SYSTEM).weights,
            options.output,
            _plan(options),
            provenance=FineTuningProvenance(
                recording=options.recording.name, system=DEFAULT_SYSTEM, command=tuning_command(options)
            ),
            work_folder=options.output.with_suffix(".finetuning"),
            on_progress=bar,
        )
    assert found is not None  # Only a cancelled call returns None, and this one cannot be cancelled.
    return found


def _plan(options: FinetuneVerb) -> FineTuningPlan:
    """Return the plan of fine-tuning with the options."""
    plan = FineTuningPlan(minutes=options.minutes)
    if options.minutes < _SHORT_MINUTES:  # Evaluating on all pairs would take longer than training.
        plan = replace(plan, validation_pairs=plan.validation_pairs // 5, validation_far=plan.validation_far // 5)
    return replace(plan, learning=replace(plan.learning, seed=options.seed))


class _ProgressBar:
    """The progress bar of fine-tuning."""

    def __init__(self) -> None:
        self._bar = tqdm(total=100.0, desc="fine-tuning", bar_format="{l_bar}{bar}| {elapsed}<{remaining}{postfix}")

    def __enter__(self) -> "_ProgressBar":
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.close()

    def __call__(self, share: float, doing: str, progress: FineTuningProgress | None) -> None:
        figures = {} if progress is None else {"step": progress.steps, "loss": f"{progress.loss:.3f}"}
        self._bar.set_postfix(doing=doing, **figures, refresh=False)
        self._bar.update(100 * share - self._bar.n)
