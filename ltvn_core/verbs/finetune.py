"""`ltvn finetune`: weights get to know the place of one recording (sections III-B and IV of the paper)."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from shutil import rmtree
from threading import Event
from typing import TYPE_CHECKING, Any

from tyro.conf import Positional

from ltvn_core.errors import OptionError, WeightsError
from ltvn_core.training.fine_tuning_data import add_simulated_pairs, read_labelled_drive
from ltvn_core.training.fine_tuning_provenance import FineTuningProvenance
from ltvn_core.verbs.verb import Summary, Verb

if TYPE_CHECKING:
    from ltvn_core.network.optimization.fine_tuning_loop import (
        FineTuningData,
        FineTuningPlan,
        FineTuningProgress,
        FineTuningResult,
    )
    from ltvn_core.training_data.trajectory_pairs import TrajectoryPairs


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


@dataclass(frozen=True, kw_only=True)
class FinetuneVerb(Verb):
    """Let weights learn from a robot's own drive; goes on where an interrupted call with the same output stopped."""

    recording: Positional[Path]
    """The recording of the drive, with odometry."""
    output: Path
    """The weights to write, with a card beside them; must not exist yet."""
    horizon: int = 15
    """H: an image counts as reachable from those up to so many images before it. Images closer than 0.1 m and 8
    degrees to the last one are left out first, so 15 images are about 1.5 m of straight driving."""
    literal: bool = False
    """Take the paper's rule as it is: all within the horizon are reachable, all others are not. Otherwise odometry and
    depth are asked as well, and pairs they are unsure of are left out."""
    weights: Path | None = None
    """Weights to start from instead of the shipped ones; they are not changed."""
    data: Path | None = None
    """A folder of `ltvn dataset` to draw simulated pairs from; without one, a few scenes are rendered once."""
    minutes: float = 3.0
    """How long to learn, beside the time that judging takes."""
    seed: int = 0
    """Draws batches and augmentation."""

    def run(self) -> Summary:
        """Fine-tune, judge and save; raises OptionError, RecordingError, DatasetError and WeightsError."""
        self._check_options()
        drive = read_labelled_drive(self.recording, horizon=self.horizon, gated=not self.literal)
        if (done := self._already_done(self._start, drive)) is not None:
            return done
        data = add_simulated_pairs(drive, self.data)
        folder = self.output.with_suffix(".finetuning")
        with _ProgressBar() as bar:
            found = self.learn(data, self.plan(), folder, on_progress=bar)
        assert found is not None  # Nobody cancels here.
        rmtree(folder, ignore_errors=True)
        return found

    def learn(
        self,
        data: "FineTuningData",
        plan: "FineTuningPlan",
        folder: Path,
        *,
        on_progress: "Callable[[FineTuningProgress], None]",
        cancelled: Event | None = None,
    ) -> FineTunedWeights | None:
        """Fine-tune on data at hand and save the weights; None if it was cancelled. Raises WeightsError."""
        from ltvn_core.network.optimization.fine_tuning_loop import run_fine_tuning

        result = run_fine_tuning(data, self._start, plan, folder, on_progress=on_progress, cancelled=cancelled)
        if result is None:
            return None
        fingerprint = self._save(result, self._start, plan, data)
        return _summary(self.output, fingerprint, _card(self.output))

    @property
    def _start(self) -> Path:
        from ltvn_core.network.shipped_weights import SHIPPED_WEIGHTS

        return self.weights or SHIPPED_WEIGHTS

    def _check_options(self) -> None:
        if self.horizon < 2:
            raise OptionError(f"--horizon must be 2 or more images, got {self.horizon}; 15 is a good start.")
        if not self.minutes > 0:
            raise OptionError(f"--minutes must be above 0, got {self.minutes:g}; 3 is a good start.")
        if self.output.suffix != ".safetensors":
            raise OptionError(f"--output must end in .safetensors, got {self.output.name}.")

    def plan(self) -> "FineTuningPlan":
        """Return what the options make of the plan."""
        from dataclasses import replace

        from ltvn_core.network.optimization.fine_tuning_loop import FineTuningPlan

        plan = FineTuningPlan(minutes=self.minutes)
        return replace(plan, learning=replace(plan.learning, seed=self.seed))

    def _run(self, start: Path, drive: "TrajectoryPairs") -> dict[str, Any]:
        from ltvn_core.network.optimization.fine_tuning_loop import trajectory_fingerprint
        from ltvn_core.network.weights_file import weights_fingerprint

        return {
            "parent": weights_fingerprint(start),
            "drive": trajectory_fingerprint(drive),
            "minutes": self.minutes,
            "seed": self.seed,
            "data": str(self.data or ""),
        }

    def _already_done(self, start: Path, drive: "TrajectoryPairs") -> FineTunedWeights | None:
        """Return the summary if the output is of this very run. Raises WeightsError if it is something else."""
        if not self.output.exists():
            return None
        card = _card(self.output)
        if card.get("run") != self._run(start, drive):
            raise WeightsError(
                f"{self.output} exists and was made otherwise; nothing is overwritten. Name another --output, or "
                "move that file away."
            )
        return _summary(self.output, card["fingerprint"], card)

    def _save(self, result: "FineTuningResult", start: Path, plan: "FineTuningPlan", data: "FineTuningData") -> str:
        from ltvn_core.network.weights_file import read_card
        from ltvn_core.training_data.trajectory_pairs import TrajectoryPairs

        drive = data.drive
        assert isinstance(drive, TrajectoryPairs)
        card = FineTuningProvenance(read_card(start), self.recording.name, self._run(start, drive), self._command())
        return card.save(result, self.output, plan, data)

    def _command(self) -> str:
        options = [f"--output {self.output.name}", f"--horizon {self.horizon}", f"--minutes {self.minutes:g}"]
        options += ["--literal"] * self.literal
        options += [
            f"--{name} {path.name}" for name in ("weights", "data") if (path := getattr(self, name)) is not None
        ]
        return " ".join([f"ltvn finetune {self.recording.name}", *options, f"--seed {self.seed}"])


def _card(weights: Path) -> dict[str, Any]:
    from ltvn_core.network.weights_file import read_card

    return read_card(weights)


def _summary(weights: Path, fingerprint: str, card: dict[str, Any]) -> FineTunedWeights:
    return FineTunedWeights(
        weights,
        fingerprint,
        card["parent"],
        card["images"],
        card["pieces"],
        card["steps"],
        card["minutes"],
        _figures(card["before"]),
        _figures(card["after"]),
    )


def _figures(metrics: dict[str, Any]) -> dict[str, float]:
    from ltvn_core.network.cards.fine_tuning_card import flat_metrics

    return flat_metrics(metrics)


class _ProgressBar:
    """A progress bar that fine-tuning fills."""

    def __init__(self) -> None:
        from tqdm import tqdm

        self._bar = tqdm(total=100.0, desc="fine-tuning", bar_format="{l_bar}{bar}| {elapsed}<{remaining}{postfix}")

    def __enter__(self) -> "_ProgressBar":
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.close()

    def __call__(self, progress: Any) -> None:
        self._bar.set_postfix(doing=progress.doing, step=progress.steps, loss=f"{progress.loss:.3f}", refresh=False)
        self._bar.update(100 * progress.share - self._bar.n)
