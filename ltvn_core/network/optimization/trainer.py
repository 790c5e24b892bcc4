"""The trainer: network, moving average of its weights and optimiser, updated step by step.

`ltvn_core.network.optimization.training_step` computes the loss of a batch;
`ltvn_core.network.optimization.training_loop` decides when to validate, mine, save and stop.
"""

import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import nn

from ltvn_core.network.architecture import AnyArchitecture, PairArchitecture
from ltvn_core.network.device import CPU
from ltvn_core.network.network_families import build_network
from ltvn_core.network.optimization.distributed import SINGLE_PROCESS, DistributedContext
from ltvn_core.network.optimization.hyperparameters import Hyperparameters
from ltvn_core.network.optimization.mixed_precision import MixedPrecision
from ltvn_core.network.optimization.training_step import TrainingStep
from ltvn_core.network.training_examples import BatchSampler, HardNegative


@dataclass(frozen=True, slots=True)
class StepLosses:
    """The losses of one step."""

    loss: float
    """Eq. 1 without the auxiliary terms."""
    total: float
    """The loss with the auxiliary terms."""


class Trainer:
    """Network, average and optimiser; the n-th step is the same whether or not training was interrupted before."""

    def __init__(self, plan: Hyperparameters, size: AnyArchitecture | None = None, device: torch.device = CPU) -> None:
        self.plan = plan
        self.device = device
        torch.manual_seed(plan.seed)
        size = size or PairArchitecture()
        self.network = build_network(size).to(device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.average = build_network(size).to(device).eval()
        self._step = TrainingStep(self.network, plan)
        self._distributed_step: nn.Module | None = None
        self.average.load_state_dict(self.network.state_dict())
        self.optimiser = torch.optim.AdamW(self.network.parameters(), plan.rate, weight_decay=plan.decay)
        self.steps = 0
        self.pairs = 0
        self.confusions: list[HardNegative] = []

    def step(
        self,
        sampler: BatchSampler,
        precision: MixedPrecision,
        progress: float,
        distributed_context: DistributedContext = SINGLE_PROCESS,
    ) -> StepLosses:
        """Update the weights with one batch per process; progress in [0, 1] sets the learning rate."""
        rng = np.random.default_rng([self.plan.seed, self.steps, distributed_context.rank])
        generator = torch.Generator(self.device).manual_seed(int(rng.integers(2**31)))
        mined = [self.confusions[k] for k in rng.permutation(len(self.confusions))[: self.plan.confusions]]
        batch = sampler.draw(rng, groups=self.plan.groups, pairs_per_group=self.plan.pairs_per_group, confusions=mined)
        for group in self.optimiser.param_groups:
            group["lr"] = self.plan.rate * learning_rate_schedule(progress, self.plan.warm_up)
        self._prepare()
        self.optimiser.zero_grad(set_to_none=True)
        loss, total, pairs = self._step_module(distributed_context)(batch, precision, rng, generator)
        total.backward()
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), 2.0)
        self.optimiser.step()
        self.steps += 1
        self.pairs += pairs * distributed_context.size
        self._update_average()
        return StepLosses(loss.item(), total.item())

    def _prepare(self) -> None:
        """Prepare the network for training."""
        self.network.train()

    def _step_module(self, distributed_context: DistributedContext) -> nn.Module:
        """Return the step; with several processes its backward pass averages their gradients."""
        if distributed_context.size == 1:
            return self._step
        if self._distributed_step is None:
            self._distributed_step = distributed_context.synchronize_gradients(self._step)
        return self._distributed_step

    @torch.no_grad()
    def _update_average(self) -> None:
        # The average of the first steps forgets faster, or the random initial weights would stay in it for long.
        keep = min(self.plan.average, (1 + self.steps) / (10 + self.steps))
        for mean, value in zip(self.average.state_dict().values(), self.network.state_dict().values(), strict=True):
            if mean.is_floating_point():
                mean.lerp_(value, 1 - keep)
            else:
                mean.copy_(value)


def learning_rate_schedule(progress: float, warm_up: float) -> float:
    """Return the share of the peak rate: a linear rise, then a cosine down to a hundredth."""
    if progress < warm_up:
        return max(progress / warm_up, 0.02)
    decayed = (min(progress, 1.0) - warm_up) / (1 - warm_up)
    return 0.01 + 0.99 * (1 + math.cos(math.pi * decayed)) / 2
