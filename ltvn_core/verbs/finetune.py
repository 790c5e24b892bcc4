"""`ltvn finetune`: weights get to know the place of one recording (sections III-B and IV of the paper)."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from tyro.conf import Positional

from ltvn_core.errors import OptionError
from ltvn_core.systems.registry import DEFAULT_SYSTEM, system_entry
from ltvn_core.verbs.verb import Summary, Verb

if TYPE_CHECKING:
    from ltvn_core.network.optimization.fine_tuning_loop import FineTuningPlan, FineTuningProgress

_SHORT_MINUTES = 0.25
"""Weights that learn for less than this are judged by a fifth of the pairs."""


@dataclass(frozen=True, kw_only=True)
class FinetuneVerb(Verb):
    """Let weights learn from a robot's own drive; goes on where an interrupted call with the same output stopped.

    The geometric predictor has no network: its calibration learns from the drive, in less than a minute.
    """

    recording: Positional[Path]
    """The recording of the drive, with odometry."""
    output: Path
    """The weights to write, with a card beside them; must not exist yet. For the geometric predictor a calibration, a
    .json file with its card in it."""
    predictor: Literal["network", "geometric"] = "network"
    """What is to learn."""
    part: str = "1/1"
    """Learn from this stretch of the drive alone, for instance 1/2, the first half; `ltvn judge --part 2/2` then judges
    by the other."""
    horizon: int = 15
    """H: an image counts as reachable from those up to so many images before it. Images closer than 0.1 m and 8
    degrees to the last one are left out first, so 15 images are about 1.5 m of straight driving."""
    literal: bool = False
    """Take the paper's rule as it is: all within the horizon are reachable, all others are not. Otherwise odometry and
    depth are asked as well, and pairs they are unsure of are left out."""
    weights: Path | None = None
    """Weights, or a calibration, to start from instead of the shipped ones; they are not changed."""
    data: Path | None = None
    """A folder of `ltvn dataset` to draw simulated pairs from; without one, a few scenes are rendered once."""
    minutes: float = 3.0
    """How long to learn, beside the time that judging takes."""
    seed: int = 0
    """Draws batches and augmentation."""

    def run(self) -> Summary:
        """Fine-tune, judge and save; raises OptionError, RecordingError, DatasetError and WeightsError."""
        self._check_options()
        return self._tune_network() if self.predictor == "network" else self._tune_calibration()

    def _tune_network(self) -> Summary:
        from ltvn_core.recording.drive_part import parse_part
        from ltvn_core.training.fine_tuning import FineTuningProvenance, fine_tune
        from ltvn_core.training.fine_tuning_data import SimulatedPairs, read_labelled_drive
        from ltvn_core.training_data.trajectory_pairs import OdometryLabelRule

        rule = OdometryLabelRule(horizon=self.horizon, gated=not self.literal)
        with _ProgressBar() as bar:
            found = fine_tune(
                read_labelled_drive(self.recording, rule, parse_part(self.part)),
                SimulatedPairs(self.data),
                self.weights or system_entry(DEFAULT_SYSTEM).weights,
                self.output,
                self._plan(),
                provenance=FineTuningProvenance(
                    recording=self.recording.name, system=DEFAULT_SYSTEM, command=self._command()
                ),
                work_folder=self.output.with_suffix(".finetuning"),
                on_progress=bar,
            )
        assert found is not None  # Nobody cancels here.
        return found

    def _tune_calibration(self) -> Summary:
        from typing import cast

        from ltvn_core.predictors.geometric import GeometricPredictor
        from ltvn_core.predictors.opening import open_predictor
        from ltvn_core.recording.drive_part import parse_part
        from ltvn_core.recording.reader import Recording
        from ltvn_core.training.calibration_tuning import tune_calibration

        part = parse_part(self.part)
        recording = Recording.open(self.recording)
        predictor = open_predictor(self.predictor, weights=self.weights, camera=recording.meta.camera)
        with _StepBar() as bar:
            return tune_calibration(
                recording,
                cast(GeometricPredictor, predictor),
                self.output,
                command=self._command(),
                part=part,
                seed=self.seed,
                on_progress=bar,
            )

    def _check_options(self) -> None:
        if self.horizon < 2:
            raise OptionError(f"--horizon must be 2 or more images, got {self.horizon}; 15 is a good start.")
        if not self.minutes > 0:
            raise OptionError(f"--minutes must be above 0, got {self.minutes:g}; 3 is a good start.")
        suffix = ".safetensors" if self.predictor == "network" else ".json"
        if self.output.suffix != suffix:
            raise OptionError(f"--output must end in {suffix}, got {self.output.name}.")

    def _plan(self) -> "FineTuningPlan":
        """Return what the options make of the plan."""
        from dataclasses import replace

        from ltvn_core.network.optimization.fine_tuning_loop import FineTuningPlan

        plan = FineTuningPlan(minutes=self.minutes)
        if self.minutes < _SHORT_MINUTES:  # Judging by all pairs would take longer than learning.
            plan = replace(plan, validation_pairs=plan.validation_pairs // 5, validation_far=plan.validation_far // 5)
        return replace(plan, learning=replace(plan.learning, seed=self.seed))

    def _command(self) -> str:
        options = [f"--output {self.output.name}"]
        if self.predictor == "network":
            options += [f"--horizon {self.horizon}", f"--minutes {self.minutes:g}"]
        else:
            options.append(f"--predictor {self.predictor}")
        options += ["--literal"] * self.literal
        options += [f"--part {self.part}"] * (self.part != "1/1")
        options += [
            f"--{name} {path.name}" for name in ("weights", "data") if (path := getattr(self, name)) is not None
        ]
        return " ".join([f"ltvn finetune {self.recording.name}", *options, f"--seed {self.seed}"])


class _ProgressBar:
    """A progress bar that fine-tuning fills."""

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


class _StepBar:
    """A progress bar for one step after the other."""

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
