"""The learning loop: steps until the time or the steps of a plan are over, with checkpoints on the way.

Training and fine-tuning are this loop; `training_loop` and `fine_tuning_loop` say what each does between the steps.
`ltvn_core.network.optimization.trainer` is one step.
"""

import math
import time
from abc import ABC, abstractmethod
from pathlib import Path

from ltvn_core.network.optimization.acceleration import (
    SINGLE_PROCESS,
    DistributedContext,
    MixedPrecision,
    choose_precision,
)
from ltvn_core.network.optimization.trainer import StepLosses, Trainer, restore_checkpoint, save_checkpoint
from ltvn_core.network.training_examples import BatchSampler


class LearningLoop(ABC):
    """The state of one training or fine-tuning; a checkpoint in its folder is continued."""

    checkpoint_every_s: float
    """Time between checkpoints."""
    newest_share: float
    """How much of the smoothed loss is that of the last step."""

    def __init__(
        self,
        trainer: Trainer,
        sampler: BatchSampler,
        folder: Path,
        *,
        minutes: float | None,
        steps: int,
        distributed_context: DistributedContext = SINGLE_PROCESS,
    ) -> None:
        """Learn for so many minutes, or for `steps` where no time is given. Raises WeightsError."""
        self.trainer = trainer
        self.sampler = sampler
        self.distributed_context = distributed_context
        self._minutes = minutes
        self._steps = steps
        self._checkpoint = folder / "checkpoint.safetensors"
        self.elapsed_s = restore_checkpoint(trainer, self._checkpoint) if self._checkpoint.exists() else 0.0
        self.loss = math.nan
        """Eq. 1, smoothed; nan before the first step."""

    def learn(self) -> bool:
        """Take steps to the end; return False if `goes_on` ended them before."""
        precision = choose_precision(self.trainer.network)
        start = time.monotonic() - self.elapsed_s
        saved = time.monotonic()
        while (before := self.progress()) < 1:
            if not self.goes_on():
                return False
            self.before_step(before, precision)
            losses = self.trainer.step(self.sampler, precision, before, self.distributed_context)
            # All processes must agree on the time, or one would wait for gradients for ever.
            self.elapsed_s = self.distributed_context.broadcast_from_leader(time.monotonic() - start)
            self._smooth(losses.loss)
            self.after_step(before, losses, precision)
            if self.distributed_context.is_leader and time.monotonic() - saved > self.checkpoint_every_s:
                self.save()
                saved = time.monotonic()
        return True

    def progress(self) -> float:
        """Return the share of learning that is done; above 1 where the last step took longer than was left."""
        if self._minutes is None:
            return self.trainer.steps / self._steps
        return self.elapsed_s / (60 * self._minutes)

    def save(self) -> None:
        """Write a checkpoint."""
        save_checkpoint(self.trainer, self._checkpoint, seconds=self.elapsed_s)

    @abstractmethod
    def goes_on(self) -> bool:
        """Return whether another step is taken."""

    @abstractmethod
    def before_step(self, progress: float, precision: MixedPrecision) -> None:
        """Do what is due before the step at this progress."""

    @abstractmethod
    def after_step(self, before: float, losses: StepLosses, precision: MixedPrecision) -> None:
        """Do what is due after a step, `before` which the progress was this."""

    def _smooth(self, loss: float) -> None:
        share = self.newest_share
        self.loss = loss if math.isnan(self.loss) else (1 - share) * self.loss + share * loss
