"""The training loop: decides when to validate, to mine hard negatives and to stop early, and keeps the best weights.

Writes `validation.jsonl`, the best weights and, if TensorBoard is installed, curves for it.
"""

import json
import logging
import math
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from tqdm import tqdm

from ltvn_core.errors import WeightsError
from ltvn_core.network.allocator import retain_freed_memory
from ltvn_core.network.architecture import AnyArchitecture, PairArchitecture
from ltvn_core.network.base_network import AnyNetwork, MixedPrecision
from ltvn_core.network.device import CPU
from ltvn_core.network.metrics import DriveMetrics, PairMetrics
from ltvn_core.network.optimization.hard_negative_mining import mine_hard_negatives
from ltvn_core.network.optimization.reachability_calibration import calibrate_reachability
from ltvn_core.network.optimization.trainer import (
    Hyperparameters,
    LearningLoop,
    StepLosses,
    Trainer,
    learning_rate_schedule,
)
from ltvn_core.network.pair_evaluation import LabelledDrive, evaluate_drives, evaluate_pairs
from ltvn_core.network.predictor import NetworkPredictor
from ltvn_core.network.training_examples import BatchSampler, SceneExamples
from ltvn_core.network.weights_file import load_weights, save_weights
from ltvn_core.structured_text import parse_json

log = logging.getLogger(__name__)

_SCALARS_EVERY = 20
"""Number of steps between two points of the curves."""

_VALIDATING = 0.1
"""Share of a training by time that validation may have taken for another one to begin before the end."""


@dataclass(frozen=True, slots=True)
class TrainingPlan:
    """Duration of training and schedule of validation and mining (all values are ours)."""

    learning: Hyperparameters = field(default_factory=Hyperparameters)
    """Hyperparameters of a step."""
    architecture: AnyArchitecture = field(default_factory=PairArchitecture)
    """Architecture of the network."""
    minutes: float | None = 45.0
    """Training time in minutes; None trains for `steps`."""
    steps: int = 6000
    """Number of training steps if `minutes` is None."""
    validations: int = 7
    """Number of validations, evenly spaced over training; the best weights are kept. With `minutes`, one is left out
    while those before took more than a tenth of the time."""
    minings: int = 14
    """Number of searches for hard negatives, evenly spaced over training after its first tenth."""
    mined_scenes: int = 4
    """Number of training scenes per search for hard negatives."""
    patience: int = 4
    """Number of consecutive validations without improvement after which training stops early."""
    validation_pairs: int = 2500
    """Number of labelled pairs per validation scene that are compared during training."""
    validation_far: int = 12000
    """Largest number of near pairs, and of far pairs, per validation drive that are compared during training."""
    bfloat16: bool = False
    """Whether layers run in bfloat16, which is faster on hardware made for it; weights stay in float32."""


@dataclass(frozen=True, slots=True)
class ValidationMetrics:
    """Metrics of one validation."""

    steps: int
    pairs: PairMetrics
    drives: DriveMetrics | None

    @property
    def score(self) -> float:
        """Return the score for choosing the best weights: few false long-range edges first, then AUC and pose."""
        false_edges = 0.0 if self.drives is None else -math.log10(self.drives.far_fpr_at_tpr60 + 1e-5)
        return false_edges + 20 * (self.pairs.auc or 0) - 5 * self.pairs.position_median_m


@dataclass(frozen=True, slots=True)
class TrainingResult:
    """The result of training."""

    weights: Path
    """The best weights, calibrated."""
    best: ValidationMetrics | None
    """Metrics of these weights on the validation data, before calibration."""
    steps: int
    """Total number of steps."""
    pairs: int
    """Number of pairs compared."""
    seconds: float
    """Total training time."""


@dataclass(frozen=True, eq=False)
class TrainingData:
    """The data for training and validation."""

    scenes: Sequence[SceneExamples]
    """Scenes to train on."""
    validation: Sequence[SceneExamples]
    """Validation scenes, used to choose the best weights and the calibration."""
    drives: Sequence[LabelledDrive] = ()
    """Drives on which false long-range edges are counted, in scenes that are not trained on."""


def train(
    data: TrainingData, plan: TrainingPlan, folder: Path, *, start: Path | None = None, device: torch.device = CPU
) -> TrainingResult:
    """Train a network and keep the weights that are best on the validation data.

    Args:
        data: Training and validation data.
        plan: Settings of the training.
        folder: Folder for checkpoint, log and best weights; a checkpoint in it is resumed.
        start: Trained weights to start from; their architecture replaces that of the plan.
        device: Device of the network.

    Raises:
        WeightsError: The checkpoint belongs to another plan, or `start` cannot be read.
    """
    folder.mkdir(parents=True, exist_ok=True)
    retain_freed_memory()
    learning = plan.learning
    begun = None if start is None else load_weights(start)
    trainer = Trainer(learning, plan.architecture, device, start=begun, precision=MixedPrecision(plan.bfloat16))
    sampler = BatchSampler(data.scenes, evened=learning.evened)
    loop = LearningLoop(trainer, sampler, folder, minutes=plan.minutes, steps=plan.steps)
    curves = TensorBoardLog(folder / "tensorboard")
    validation = Validation(data, plan, folder, curves)
    bar = tqdm(
        total=100.0,
        initial=round(100 * loop.progress(), 1),
        desc="training",
        bar_format="{l_bar}{bar}| {elapsed}<{remaining}{postfix}",
        mininterval=1.0,
    )

    def after_step(before: float, losses: StepLosses) -> None:
        progress = loop.progress()
        bar.set_postfix(step=trainer.steps, loss=f"{loop.loss:.3f}", refresh=False)
        bar.update(100 * min(progress, 1) - bar.n)
        if trainer.steps % _SCALARS_EVERY == 0:
            figures = {
                "loss": losses.loss,
                "total": losses.total,
                "rate": learning.rate * learning_rate_schedule(progress, learning.warm_up),
                "pairs_per_s": trainer.pairs / max(loop.elapsed_s, 1e-3),
                "confusions": len(trainer.confusions),
            }
            curves.add(trainer.steps, "training", figures)
        late = plan.minutes is not None and validation.seconds > _VALIDATING * loop.elapsed_s
        if _due(before, progress, plan.validations, begin=0.0) and not late:
            validation.validate(trainer.average, trainer.steps, seconds=loop.elapsed_s)
        elif _due(before, progress, plan.minings, begin=0.1):
            _mine(trainer, data.scenes, plan.mined_scenes)

    loop.learn(lambda progress: validation.without_improvement < plan.patience, after_step)
    bar.close()
    loop.save()
    if validation.best is None or validation.best.steps != trainer.steps:
        validation.validate(trainer.average, trainer.steps, seconds=loop.elapsed_s)
    curves.close()
    network = load_weights(validation.weights)
    calibrate_reachability(network, [(scene, np.arange(len(scene.sources))) for scene in data.validation])
    weights = folder / "weights.safetensors"
    save_weights(network, weights)
    return TrainingResult(
        weights=weights, best=validation.best, steps=trainer.steps, pairs=trainer.pairs, seconds=loop.elapsed_s
    )


def _mine(trainer: Trainer, scenes: Sequence[SceneExamples], count: int) -> None:
    """Search some of the scenes for hard negatives; the trainer keeps those of the others."""
    rng = np.random.default_rng([trainer.plan.seed, trainer.steps, 0, 1])
    for number in rng.choice(len(scenes), min(count, len(scenes)), replace=False).tolist():
        found = mine_hard_negatives(trainer.average, trainer.precision, scenes[number], number, trainer.plan.far, rng)
        # At most 200 per scene, so that one confusing scene does not fill all batches.
        trainer.confusions = [each for each in trainer.confusions if each.scene != number] + found[:200]
    log.info("mined %d confusions", len(trainer.confusions))


def _due(before: float, after: float, times: int, *, begin: float) -> bool:
    """Return whether one of `times` evenly spaced moments after `begin` lies in (before, after]."""
    if times == 0:
        return False
    spacing = (1 - begin) / times
    return math.floor((after - begin) / spacing) > math.floor((before - begin) / spacing) and after >= begin + 1e-9


class TensorBoardLog:
    """Curves for TensorBoard over the steps of one training run."""

    def __init__(self, folder: Path) -> None:
        """Write the curves to a folder; without TensorBoard, nothing is written."""
        self._writer: Any = None
        try:
            from torch.utils.tensorboard import SummaryWriter
        except ImportError:
            log.info("No curves for TensorBoard: it is not installed; `pip install tensorboard` adds it.")
            return
        self._writer = SummaryWriter(folder)
        log.info("Curves: tensorboard --logdir %s", folder)

    def add(self, step: int, group: str, values: Mapping[str, float]) -> None:
        """Add a point to each curve of a group."""
        if self._writer is not None:
            for name, value in values.items():
                self._writer.add_scalar(f"{group}/{name}", value, step)

    def close(self) -> None:
        """Write pending points and close the file."""
        if self._writer is not None:
            self._writer.close()


class Validation:
    """Evaluates the weights of one training run, and saves the best ones and all metrics in its folder."""

    def __init__(self, data: TrainingData, plan: TrainingPlan, folder: Path, curves: TensorBoardLog) -> None:
        self._data = data
        self._plan = plan
        self._curves = curves
        self.weights = folder / "best.safetensors"
        self._log = folder / "validation.jsonl"
        self.best = _read_best(self._log)
        """Metrics of the best weights so far, including those before an interruption."""
        self.without_improvement = 0
        """Number of consecutive validations without improvement."""
        self.seconds = 0.0
        """Time that validation took in this process."""

    def validate(self, network: AnyNetwork, steps: int, *, seconds: float) -> None:
        """Evaluate weights after the given steps and seconds, and keep them if they are the best so far."""
        begin = time.monotonic()
        predictor = NetworkPredictor(network, "in training")
        data, plan = self._data, self._plan
        # The same pairs in every validation, so that scores are comparable.
        rng = np.random.default_rng(0)
        found = ValidationMetrics(
            steps,
            evaluate_pairs(predictor, data.validation, rng, limit=plan.validation_pairs),
            evaluate_drives(predictor, data.drives, rng, limit=plan.validation_far) if data.drives else None,
        )
        self.seconds += time.monotonic() - begin
        log.info("step %d: score %.3f %s %s", found.steps, found.score, found.pairs, found.drives)
        is_best = self.best is None or found.score > self.best.score
        self._write(found, seconds)
        self._curves.add(found.steps, "pairs", asdict(found.pairs))
        self._curves.add(found.steps, "drives", asdict(found.drives) if found.drives else {})
        if is_best:
            self.best = found
            self.without_improvement = 0
            save_weights(network, self.weights)
        else:
            self.without_improvement += 1

    def _write(self, found: ValidationMetrics, seconds: float) -> None:
        """Append metrics to the log."""
        times = {"seconds": round(seconds), "validating_s": self.seconds}
        line = json.dumps({**times, "score": found.score, **asdict(found)})
        try:
            with self._log.open("a", encoding="utf-8") as file:
                file.write(line + "\n")
        except OSError as error:
            raise WeightsError(
                f"{self._log.parent}: metrics could not be written ({error}); free some space and run again to resume "
                "from the last checkpoint."
            ) from error


def _read_best(path: Path) -> ValidationMetrics | None:
    """Return the best metrics in the log of an interrupted training; an incomplete line counts for nothing."""
    read = list[ValidationMetrics]()
    with suppress(OSError):
        for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
            with suppress(ValueError, LookupError, TypeError):
                found = parse_json(line)
                drives = DriveMetrics(**found["drives"]) if found["drives"] else None
                read.append(ValidationMetrics(found["steps"], PairMetrics(**found["pairs"]), drives))
    return max(read, key=lambda each: each.score, default=None)
