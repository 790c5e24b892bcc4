"""The training loop: steps, hard-negative mining, checkpoints and early stopping.

`ltvn_core.network.optimization.trainer` is one step, `ltvn_core.network.optimization.validation` says which weights are
best.
"""

import logging
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
from tqdm import tqdm

from ltvn_core.network.allocator import retain_freed_memory
from ltvn_core.network.architecture import AnyArchitecture, PairArchitecture
from ltvn_core.network.metrics.pair_evaluation import LabelledDrive
from ltvn_core.network.optimization.checkpoint import restore_checkpoint, save_checkpoint
from ltvn_core.network.optimization.distributed import SINGLE_PROCESS, DistributedContext, run_distributed
from ltvn_core.network.optimization.hard_negative_mining import mine_hard_negatives
from ltvn_core.network.optimization.mixed_precision import MixedPrecision, choose_precision
from ltvn_core.network.optimization.reachability_calibration import calibrate_reachability
from ltvn_core.network.optimization.trainer import (
    FineTuningTrainer,
    Hyperparameters,
    StepLosses,
    Trainer,
    learning_rate_schedule,
)
from ltvn_core.network.optimization.validation import TensorBoardLog, Validation, ValidationData, ValidationMetrics
from ltvn_core.network.training_examples import BatchSampler, SceneExamples
from ltvn_core.network.weights_file import load_weights, save_weights

log = logging.getLogger(__name__)

_CHECKPOINT_SECONDS = 60.0

_SCALARS_EVERY = 20
"""Steps between points of the curves."""


@dataclass(frozen=True, slots=True)
class TrainingPlan:
    """Duration of training and schedule of validation and mining (all values are ours)."""

    learning: Hyperparameters = field(default_factory=Hyperparameters)
    """What each step does."""
    architecture: AnyArchitecture = field(default_factory=PairArchitecture)
    """The network to train."""
    minutes: float | None = 45.0
    """Time to train for; None trains for `steps`."""
    steps: int = 6000
    """Steps to train for where no time is given."""
    validations: int = 7
    """Number of validations, evenly over training; the best weights are kept."""
    minings: int = 14
    """Number of searches for hard negatives, evenly over training after its first tenth."""
    mined_scenes: int = 4
    """Training scenes that each process searches in each of them."""
    patience: int = 4
    """Stop after this many validations in a row without a better one."""
    validation_pairs: int = 2500
    """Labelled pairs of each validation scene that are compared during training,"""
    validation_far: int = 12000
    """and far pairs of each drive."""


@dataclass(frozen=True, slots=True)
class TrainingResult:
    """The result of training."""

    weights: Path
    """The best weights, calibrated."""
    best: ValidationMetrics | None
    """Their metrics on validation, before calibration; only the leading process has them."""
    steps: int
    """Steps in all."""
    pairs: int
    """Pairs compared, about: all processes draw nearly the same number."""
    seconds: float
    """Time in all."""


@dataclass(frozen=True, eq=False)
class TrainingData:
    """The data for training and validation."""

    scenes: Sequence[SceneExamples]
    """Scenes to train on."""
    validation: Sequence[SceneExamples]
    """Scenes by which the best weights and the calibration are chosen."""
    drives: Sequence[LabelledDrive] = ()
    """Drives to count false long-range edges on, in scenes that are not trained on."""


def train(
    data: TrainingData,
    plan: TrainingPlan,
    folder: Path,
    distributed_context: DistributedContext = SINGLE_PROCESS,
    *,
    start: Path | None = None,
) -> TrainingResult:
    """Train a network and keep the weights that are best on the validation data.

    Args:
        data: What to train and validate on.
        plan: Settings of the training.
        folder: Where checkpoint, log and best weights are written; a checkpoint in it is resumed.
        distributed_context: This process among those that train together.
        start: Trained weights to start from, on a CPU; their architecture replaces that of the plan.

    Raises:
        WeightsError: The checkpoint belongs to another plan, or `start` cannot be read.
    """
    folder.mkdir(parents=True, exist_ok=True)
    retain_freed_memory()
    return _TrainingRun(data, plan, folder, distributed_context, start).run()


def train_distributed(
    load: Callable[[], TrainingData], plan: TrainingPlan, folder: Path, *, processes: int
) -> TrainingResult:
    """Train in several processes, each of which loads the data itself; `load` must be picklable."""
    return run_distributed(partial(_train_worker, load, plan, folder), processes)


def _train_worker(
    load: Callable[[], TrainingData], plan: TrainingPlan, folder: Path, distributed_context: DistributedContext
) -> TrainingResult:
    if distributed_context.size > 1:
        logging.basicConfig(
            level=logging.INFO if distributed_context.is_leader else logging.WARNING, format="%(asctime)s %(message)s"
        )
    return train(load(), plan, folder, distributed_context)


class _TrainingRun:
    """The state of one training."""

    def __init__(
        self,
        data: TrainingData,
        plan: TrainingPlan,
        folder: Path,
        distributed_context: DistributedContext,
        start: Path | None,
    ) -> None:
        self.data = data
        self.plan = plan
        self.folder = folder
        self.distributed_context = distributed_context
        self.sampler = BatchSampler(data.scenes, evened=plan.learning.evened)
        self.trainer = _create_trainer(plan, distributed_context, start)
        self.checkpoint = folder / "checkpoint.safetensors"
        self.elapsed_s = restore_checkpoint(self.trainer, self.checkpoint) if self.checkpoint.exists() else 0.0
        self.scalars = TensorBoardLog(folder / "tensorboard") if distributed_context.is_leader else None
        compared = ValidationData(
            scenes=data.validation, drives=data.drives, pairs=plan.validation_pairs, far=plan.validation_far
        )
        self.validation = Validation(compared, folder, self.scalars)

    def run(self) -> TrainingResult:
        precision = choose_precision(self.trainer.network)
        start = time.monotonic() - self.elapsed_s
        saved = time.monotonic()
        bar = tqdm(
            total=100.0,
            initial=round(100 * self.progress(), 1),
            desc="training",
            bar_format="{l_bar}{bar}| {elapsed}<{remaining}{postfix}",
            disable=not self.distributed_context.is_leader,
            mininterval=1.0,
        )
        mean = math.nan
        # All processes must agree on when to stop and on the time, or one would wait for gradients for ever.
        while (before := self.progress()) < 1 and self.distributed_context.broadcast_from_leader(
            self.validation.without_improvement
        ) < self.plan.patience:
            report = self.trainer.step(self.sampler, precision, before, self.distributed_context)
            self.elapsed_s = self.distributed_context.broadcast_from_leader(time.monotonic() - start)
            mean = report.loss if math.isnan(mean) else 0.98 * mean + 0.02 * report.loss
            bar.set_postfix(step=self.trainer.steps, loss=f"{mean:.3f}", refresh=False)
            bar.update(100 * min(self.progress(), 1) - bar.n)
            self._plot(report)
            self._validate_or_mine(before, precision)
            if self.distributed_context.is_leader and time.monotonic() - saved > _CHECKPOINT_SECONDS:
                save_checkpoint(self.trainer, self.checkpoint, seconds=self.elapsed_s)
                saved = time.monotonic()
        bar.close()
        return self._finish()

    def progress(self) -> float:
        """Return the share of training that is done."""
        if self.plan.minutes is None:
            return self.trainer.steps / self.plan.steps
        return self.elapsed_s / (60 * self.plan.minutes)

    def _plot(self, report: StepLosses) -> None:
        if self.scalars is None or self.trainer.steps % _SCALARS_EVERY:
            return
        rate = self.plan.learning.rate * learning_rate_schedule(self.progress(), self.plan.learning.warm_up)
        self.scalars.add(
            self.trainer.steps,
            training__loss=report.loss,
            training__total=report.total,
            training__rate=rate,
            training__pairs_per_s=self.trainer.pairs / max(self.elapsed_s, 1e-3),
            training__confusions=len(self.trainer.confusions),
        )

    def _validate_or_mine(self, before: float, precision: MixedPrecision) -> None:
        """Validate and mine when they are due; while the leader validates, the others mine."""
        validating = _due(before, self.progress(), self.plan.validations, begin=0.0)
        mining = _due(before, self.progress(), self.plan.minings, begin=0.1)
        if validating and self.distributed_context.is_leader:
            self._validate()
        elif mining or (validating and self.plan.minings > 0 and self.progress() > 0.1):
            self._mine(precision)

    def _mine(self, precision: MixedPrecision) -> None:
        rng = np.random.default_rng([self.plan.learning.seed, self.trainer.steps, self.distributed_context.rank, 1])
        scenes = self.data.scenes
        for number in rng.choice(len(scenes), min(self.plan.mined_scenes, len(scenes)), replace=False):
            scene = scenes[int(number)]
            kept = [c for c in self.trainer.confusions if c.scene != number]
            found = mine_hard_negatives(
                self.trainer.average, precision, scene, int(number), self.plan.learning.far, rng
            )
            # At most 200 per scene, so that one confusing scene does not fill all batches.
            self.trainer.confusions = kept + found[:200]
        log.info("mined %d confusions", len(self.trainer.confusions))

    def _validate(self) -> None:
        """Evaluate the averaged weights and keep them if they are the best so far."""
        self.validation.validate(self.trainer.average, self.trainer.steps, seconds=self.elapsed_s)

    def _finish(self) -> TrainingResult:
        weights = self.folder / "weights.safetensors"
        if self.scalars is not None:
            self.scalars.close()
        if self.distributed_context.is_leader:
            save_checkpoint(self.trainer, self.checkpoint, seconds=self.elapsed_s)
            if self.validation.best is None or self.validation.best.steps != self.trainer.steps:
                self._validate()
            network = load_weights(self.validation.weights)
            calibrate_reachability(network, [(scene, np.arange(len(scene.sources))) for scene in self.data.validation])
            save_weights(network, weights)
        return TrainingResult(
            weights=weights,
            best=self.validation.best,
            steps=self.trainer.steps,
            pairs=self.trainer.pairs,
            seconds=self.elapsed_s,
        )


def _create_trainer(plan: TrainingPlan, distributed_context: DistributedContext, start: Path | None) -> Trainer:
    if start is not None:
        return FineTuningTrainer(plan.learning, load_weights(start))
    return Trainer(plan.learning, plan.architecture, distributed_context.device)


def _due(before: float, after: float, times: int, *, begin: float) -> bool:
    """Return whether one of `times` evenly spaced moments after `begin` lies in (before, after]."""
    if times == 0:
        return False
    spacing = (1 - begin) / times
    return math.floor((after - begin) / spacing) > math.floor((before - begin) / spacing) and after >= begin + 1e-9
