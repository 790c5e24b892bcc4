"""`ltvn finetune`: adapts weights to the place of one recording (sections III-B and IV of the paper)."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal, cast

from tyro.conf import Positional

from ltvn_core.data.recording.drive_part import parse_part
from ltvn_core.errors import OptionError
from ltvn_core.sole_writer import sole_user
from ltvn_core.systems.registry import DEFAULT_SYSTEM, system_entry
from ltvn_core.verbs.option_types import DeviceOption
from ltvn_core.verbs.outputs import NewWeights
from ltvn_core.verbs.verb import Summary, Verb

if TYPE_CHECKING:
    from ltvn_core.network.optimization.fine_tuning_loop import FineTuningProgress

_SHORT_MINUTES = 0.25
"""Time of training, in minutes, below which weights are evaluated on a fifth of the pairs."""


@dataclass(frozen=True, kw_only=True)
class FinetuneVerb(Verb):
    """Fine-tune weights on a robot's own drive; continues an interrupted call with the same output.

    The geometric predictor has no network. Its calibration is fitted to the drive in less than a minute.
    """

    recording: Positional[Path]
    """The recording of the drive, with odometry."""
    output: NewWeights
    """The weights to write, with a card beside them; must not exist yet. For the geometric predictor, a .json file with
    the calibration and its card."""
    predictor: Literal["network", "geometric"] = "network"
    """Predictor to train."""
    part: str = "1/1"
    """Learn only from this part of the drive, for instance 1/2 for the first half; `ltvn judge --part 2/2` then tests
    on the other half."""
    horizon: int = 15
    """H: an image counts as reachable from the H images before it. First, images closer than 0.1 m and 8 degrees to the
    previous one are left out, so that 15 images are about 1.5 m of straight driving."""
    literal: bool = False
    """Use the paper's rule without changes: all pairs within the horizon are reachable, all others are not. By default,
    odometry and depth are checked as well, and uncertain pairs are left out."""
    weights: Path | None = None
    """Weights or calibration to start from instead of the shipped ones; the file is not changed."""
    data: Path | None = None
    """A folder of `ltvn dataset` with simulated pairs; by default, a few scenes are rendered once."""
    minutes: float = 3.0
    """Time for training in minutes, without the evaluation."""
    device: DeviceOption = "auto"
    seed: int = 0
    """Seed of batches and augmentation."""

    def run(self) -> Summary:
        """Fine-tune, evaluate and save; raises OptionError, RecordingError, DatasetError and WeightsError."""
        check_options(self)
        if self.predictor != "network":
            return finetune_calibration(self)
        from ltvn_core.network.optimization.fine_tuning_loop import FineTuningPlan
        from ltvn_core.network.training_data.trajectory_pairs import OdometryLabelRule
        from ltvn_core.training.fine_tuning import FineTuningProvenance, fine_tune
        from ltvn_core.training.fine_tuning_data import RehearsalData, read_labelled_drive

        rule = OdometryLabelRule(horizon=self.horizon, gated=not self.literal)
        plan = FineTuningPlan(minutes=self.minutes)
        if self.minutes < _SHORT_MINUTES:  # Evaluating on all pairs would take longer than training.
            plan = replace(plan, validation_pairs=plan.validation_pairs // 5, validation_far=plan.validation_far // 5)
        plan = replace(plan, learning=replace(plan.learning, seed=self.seed))
        with sole_user(self.output), _ProgressBar() as bar:
            found = fine_tune(
                read_labelled_drive(self.recording, rule, parse_part(self.part)),
                RehearsalData(self.data),
                self.weights or system_entry(DEFAULT_SYSTEM).weights,
                self.output,
                plan,
                provenance=FineTuningProvenance(
                    recording=self.recording.name, system=DEFAULT_SYSTEM, command=tuning_command(self)
                ),
                work_folder=self.output.with_suffix(".finetuning"),
                on_progress=bar,
                device=self.device,
            )
        assert found is not None  # Only a cancelled call returns None, and this one cannot be cancelled.
        return found


class _ProgressBar:
    """The progress bar of fine-tuning."""

    def __init__(self) -> None:
        from tqdm import tqdm

        self._bar = tqdm(total=100.0, desc="fine-tuning", bar_format="{l_bar}{bar}| {elapsed}<{remaining}{postfix}")

    def __enter__(self) -> "_ProgressBar":
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.close()

    def __call__(self, share: float, doing: str, progress: "FineTuningProgress | None") -> None:
        figures = {} if progress is None else {"step": progress.steps, "loss": f"{progress.loss:.3f}"}
        self._bar.set_postfix(doing=doing, **figures, refresh=False)
        self._bar.update(100 * share - self._bar.n)


def finetune_calibration(options: FinetuneVerb) -> Summary:
    """Fit, evaluate and save; raises OptionError and RecordingError."""
    from ltvn_core.data.recording.reader import Recording
    from ltvn_core.predictors.geometric import GeometricPredictor
    from ltvn_core.predictors.opening import open_predictor
    from ltvn_core.training.calibration_tuning import tune_calibration

    part = parse_part(options.part)
    recording = Recording.open(options.recording)
    predictor = open_predictor(options.predictor, weights=options.weights, camera=recording.meta.camera)
    with _StepBar() as bar:
        return tune_calibration(
            recording,
            cast(GeometricPredictor, predictor),
            options.output,
            command=tuning_command(options),
            part=part,
            seed=options.seed,
            on_progress=bar,
        )


def check_options(options: FinetuneVerb) -> None:
    """Raise OptionError for invalid options, for either predictor."""
    if options.horizon < 2:
        raise OptionError(f"--horizon must be 2 or more images, got {options.horizon}; 15 is a good start.")
    if not options.minutes > 0:
        raise OptionError(f"--minutes must be above 0, got {options.minutes:g}; 3 is a good start.")
    suffix = ".safetensors" if options.predictor == "network" else ".json"
    if options.output.suffix != suffix:
        raise OptionError(f"--output must end in {suffix}, got {options.output.name}.")


def tuning_command(options: FinetuneVerb) -> str:
    """Return the command line for a card."""
    words = [f"--output {options.output.name}"]
    if options.predictor == "network":
        words += [f"--horizon {options.horizon}", f"--minutes {options.minutes:g}"]
    else:
        words.append(f"--predictor {options.predictor}")
    words += ["--literal"] * options.literal
    words += [f"--part {options.part}"] * (options.part != "1/1")
    words += [f"--{name} {path.name}" for name in ("weights", "data") if (path := getattr(options, name)) is not None]
    return " ".join([f"ltvn finetune {options.recording.name}", *words, f"--seed {options.seed}"])


class _StepBar:
    """A progress bar for consecutive steps."""

    def __init__(self) -> None:
        from tqdm import tqdm

        self._bar = tqdm(desc="read")

    def __enter__(self) -> "_StepBar":
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.close()

    def __call__(self, step: str, done: int, total: int) -> None:
        if done == 1:
            self._bar.reset(total)
            self._bar.set_description(step)
        self._bar.update(1)
