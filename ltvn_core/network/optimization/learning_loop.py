"""The learning loop: runs steps until the time or the number of steps of a plan is reached, and saves checkpoints.

Training and fine-tuning share this loop; `training_loop` and `fine_tuning_loop` define what each does between steps.
`ltvn_core.network.optimization.trainer` runs one step.
"""

import math
import time
from abc import ABC, abstractmethod
from pathlib import Path

from ltvn_core.network.optimization.acceleration import FLOAT32, SINGLE_PROCESS, DistributedContext, MixedPrecision
from ltvn_core.network.optimization.trainer import StepLosses, Trainer, restore_checkpoint, save_checkpoint
from ltvn_core.network.training_examples import BatchSampler


class LearningLoop(ABC):
    """The state of one training or fine-tuning run; a checkpoint in its folder is resumed."""

    checkpoint_every_s: float
    """Time between checkpoints, in seconds."""
    newest_share: float
    """Weight of the last step in the smoothed loss (exponential moving average)."""

    def __init__(
        self,
        trainer: Trainer,
        sampler: BatchSampler,
        folder: Path,
        *,
        minutes: float | None,
        steps: int,
        precision: MixedPrecision = FLOAT32,
        distributed_context: DistributedContext = SINGLE_PROCESS,
    ) -> None:
        """Learn for `minutes`, or for `steps` if `minutes` is None. Raises WeightsError for an unusable checkpoint."""
        self.trainer = trainer
        self.sampler = sampler
        self.distributed_context = distributed_context
        self._precision = precision
        self._minutes = minutes
        self._steps = steps
        self._checkpoint = folder / "checkpoint.safetensors"
        self.elapsed_s = restore_checkpoint(trainer, self._checkpoint) if self._checkpoint.exists() else 0.0
        self.loss = math.nan
        """Eq. 1, smoothed; nan before the first step."""

    def learn(self) -> bool:
        """Run all remaining steps; return False if `goes_on` stopped them early."""
        start = time.monotonic() - self.elapsed_s
        saved = time.monotonic()
        while (before := self.progress()) < 1:
            if not self.goes_on():
                return False
            self.before_step(before, self._precision)
            losses = self.trainer.step(self.sampler, self._precision, before, self.distributed_context)
            # All processes must agree on the time, or one would wait for gradients forever.
            self.elapsed_s = self.distributed_context.broadcast_from_leader(time.monotonic() - start)
            self._smooth(losses.loss)
            self.after_step(before, losses, self._precision)
            if self.distributed_context.is_leader and time.monotonic() - saved > self.checkpoint_every_s:
                self.save()
                saved = time.monotonic()
        return True

    def progress(self) -> float:
        """Return the finished share of the training; above 1 if the last step took longer than the remaining time."""
        if self._minutes is None:
            return self.trainer.steps / self._steps
        return self.elapsed_s / (60 * self._minutes)

    def save(self) -> None:
        """Write a checkpoint."""
        save_checkpoint(self.trainer, self._checkpoint, seconds=self.elapsed_s)

    @abstractmethod
    def goes_on(self) -> bool:
        """Return whether to run another step."""

    @abstractmethod
    def before_step(self, progress: float, precision: MixedPrecision) -> None:
        """Do what is due before the step at this progress."""

    @abstractmethod
    def after_step(self, before: float, losses: StepLosses, precision: MixedPrecision) -> None:
        """Do what is due after a step; `before` is the progress before the step."""

    def _smooth(self, loss: float) -> None:
        share = self.newest_share
        self.loss = loss if math.isnan(self.loss) else (1 - share) * self.loss + share * loss
