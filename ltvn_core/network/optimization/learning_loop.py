"""The learning loop: runs steps until the time or the number of steps of a plan is reached, and saves checkpoints.

Training, fine-tuning and the training of rivals are this loop with callbacks between the steps.
`ltvn_core.network.optimization.trainer` runs one step.
"""

import math
import time
from collections.abc import Callable
from pathlib import Path

from ltvn_core.network.optimization.mixed_precision import FLOAT32, MixedPrecision
from ltvn_core.network.optimization.trainer import StepLosses, Trainer, restore_checkpoint, save_checkpoint
from ltvn_core.network.training_examples import BatchSampler

_CHECKPOINT_EVERY_S = 30.0
_NEWEST_SHARE = 0.05
"""Weight of the last step in the smoothed loss (exponential moving average)."""


class LearningLoop:
    """One training or fine-tuning run; a checkpoint in its folder is resumed."""

    def __init__(
        self,
        trainer: Trainer,
        sampler: BatchSampler,
        folder: Path,
        *,
        minutes: float | None,
        steps: int,
        precision: MixedPrecision = FLOAT32,
    ) -> None:
        """Learn for `minutes`, or for `steps` if `minutes` is None. Raises WeightsError for an unusable checkpoint."""
        self.trainer = trainer
        self._sampler = sampler
        self._precision = precision
        self._minutes = minutes
        self._steps = steps
        self._checkpoint = folder / "checkpoint.safetensors"
        self.elapsed_s = restore_checkpoint(trainer, self._checkpoint) if self._checkpoint.exists() else 0.0
        self.loss = math.nan
        """Eq. 1, smoothed; nan before the first step."""

    def learn(self, before_step: Callable[[float], bool], after_step: Callable[[float, StepLosses], None]) -> bool:
        """Run all remaining steps, and return whether they all ran.

        Args:
            before_step: Called with the progress before each step; False stops early.
            after_step: Called with the progress before the step, and with its losses.
        """
        start = time.monotonic() - self.elapsed_s
        saved = time.monotonic()
        while (before := self.progress()) < 1:
            if not before_step(before):
                return False
            losses = self.trainer.step(self._sampler, self._precision, before)
            self.elapsed_s = time.monotonic() - start
            first = math.isnan(self.loss)
            self.loss = losses.loss if first else (1 - _NEWEST_SHARE) * self.loss + _NEWEST_SHARE * losses.loss
            after_step(before, losses)
            if time.monotonic() - saved > _CHECKPOINT_EVERY_S:
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
