"""One learning step, and the state it changes: network, its moving average, the optimiser.

Owns the update. How a batch becomes a loss is `ltvn_core.model.learning_step`; when to stop, validate, mine or save is
decided in `ltvn_core.model.training`.
"""

import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import nn

from ltvn_core.model.architecture import AnyArchitecture, Architecture
from ltvn_core.model.device import CPU
from ltvn_core.model.examples import Confusion, ExamplePool
from ltvn_core.model.families import build_network
from ltvn_core.model.learning_plan import LearningPlan
from ltvn_core.model.learning_step import LearningStep
from ltvn_core.model.precision import Precision
from ltvn_core.model.team import ALONE, Team


@dataclass(frozen=True, slots=True)
class StepReport:
    """What one step saw."""

    loss: float
    """Eq. 1 without the auxiliary terms."""
    total: float
    """All that was minimised."""


class Learner:
    """Network, average and optimiser; the n-th step is the same whether or not training was interrupted before."""

    def __init__(self, plan: LearningPlan, size: AnyArchitecture | None = None, device: torch.device = CPU) -> None:
        self.plan, self.device = plan, device
        torch.manual_seed(plan.seed)
        size = size or Architecture()
        self.network = build_network(size).to(device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.average = build_network(size).to(device).eval()
        self._step = LearningStep(self.network, plan)
        self._team_step: nn.Module | None = None
        self.average.load_state_dict(self.network.state_dict())
        self.optimiser = torch.optim.AdamW(self.network.parameters(), plan.rate, weight_decay=plan.decay)
        self.steps = 0
        self.pairs = 0
        self.confusions: list[Confusion] = []

    def step(self, pool: ExamplePool, precision: Precision, progress: float, team: Team = ALONE) -> StepReport:
        """Learn from one batch per process; progress in [0, 1] sets the learning rate."""
        rng = np.random.default_rng([self.plan.seed, self.steps, team.rank])
        generator = torch.Generator(self.device).manual_seed(int(rng.integers(2**31)))
        mined = [self.confusions[k] for k in rng.permutation(len(self.confusions))[: self.plan.confusions]]
        batch = pool.draw(rng, groups=self.plan.groups, pairs_per_group=self.plan.pairs_per_group, confusions=mined)
        for group in self.optimiser.param_groups:
            group["lr"] = self.plan.rate * schedule(progress, self.plan.warm_up)
        self._prepare()
        self.optimiser.zero_grad(set_to_none=True)
        loss, total, pairs = self._shared_step(team)(batch, precision, rng, generator)
        total.backward()
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), 2.0)
        self.optimiser.step()
        self.steps += 1
        self.pairs += pairs * team.size
        self._update_average()
        return StepReport(loss.item(), total.item())

    def _prepare(self) -> None:
        """Make the network ready to learn."""
        self.network.train()

    def _shared_step(self, team: Team) -> nn.Module:
        """Return the step; in a team, its backward pass averages the gradients of all processes."""
        if team.size == 1:
            return self._step
        if self._team_step is None:
            self._team_step = team.share(self._step)
        return self._team_step

    @torch.no_grad()
    def _update_average(self) -> None:
        keep = min(self.plan.average, (1 + self.steps) / (10 + self.steps))
        for mean, value in zip(self.average.state_dict().values(), self.network.state_dict().values(), strict=True):
            if mean.is_floating_point():
                mean.lerp_(value, 1 - keep)
            else:
                mean.copy_(value)


def schedule(progress: float, warm_up: float) -> float:
    """Return the share of the peak rate: a linear rise, then a cosine down to a hundredth."""
    if progress < warm_up:
        return max(progress / warm_up, 0.02)
    fallen = (min(progress, 1.0) - warm_up) / (1 - warm_up)
    return 0.01 + 0.99 * (1 + math.cos(math.pi * fallen)) / 2
