"""One learning step, and the state it changes: network, its moving average, the optimiser.

Owns how a batch becomes a gradient. When to stop, validate, mine or save is decided in `ltvn_core.model.training`.
"""

import math
from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor

from ltvn_core.model.architecture import AnyArchitecture, Architecture
from ltvn_core.model.augmentation import Augmentation, augment, mirror
from ltvn_core.model.contract import Compared
from ltvn_core.model.examples import Batch, Confusion, ExamplePool
from ltvn_core.model.families import build_network
from ltvn_core.model.features import Encoded
from ltvn_core.model.loss import pair_loss
from ltvn_core.model.mining import Far, hardest
from ltvn_core.model.precision import Precision
from ltvn_core.model.predictor import images_to_tensors
from ltvn_core.model.team import ALONE, Team


@dataclass(frozen=True, slots=True)
class LearningPlan:
    """What one step does (all values ours; the paper states none)."""

    seed: int = 0
    """Seeds initial weights, batches and augmentation."""
    alpha: float = 3.0
    """Weight of the position error in Eq. 1."""
    beta: float = 3.0
    """Weight of the yaw error in Eq. 1."""
    matching: float = 0.15
    """Weight of the auxiliary loss on token matches, in networks that match."""
    place: float = 0.1
    """Weight of the auxiliary loss on the cheap place score, in networks that have one."""
    groups: int = 10
    """Clusters of images per step and process."""
    pairs_per_group: int = 18
    """Labelled pairs per cluster."""
    confusions: int = 2
    """Mined far pairs per step, each bringing both its clusters along."""
    hard: int = 40
    """Far pairs of the step's images that look most alike to the network's rough score, or any if it has none."""
    random: int = 12
    """Far pairs drawn at random."""
    rate: float = 2e-3
    """Peak learning rate of AdamW."""
    warm_up: float = 0.03
    """Share of training over which the rate rises."""
    decay: float = 0.01
    """Weight decay."""
    average: float = 0.998
    """How much of the moving average of the weights stays at each step."""
    far: Far = field(default_factory=Far)
    """What is certainly not reachable."""
    augmentation: Augmentation = field(default_factory=Augmentation)
    """Changes of the images."""


@dataclass(frozen=True, slots=True)
class StepReport:
    """What one step saw."""

    loss: float
    """Eq. 1 without the auxiliary terms."""
    total: float
    """All that was minimised."""


class Learner:
    """Network, average and optimiser; the n-th step is the same whether or not training was interrupted before."""

    def __init__(self, plan: LearningPlan, size: AnyArchitecture | None = None) -> None:
        self.plan = plan
        torch.manual_seed(plan.seed)
        size = size or Architecture()
        self.network = build_network(size).to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.average = build_network(size).eval()
        self.average.load_state_dict(self.network.state_dict())
        self.optimiser = torch.optim.AdamW(self.network.parameters(), plan.rate, weight_decay=plan.decay)
        self.steps = 0
        self.pairs = 0
        self.confusions: list[Confusion] = []

    def step(self, pool: ExamplePool, precision: Precision, progress: float, team: Team = ALONE) -> StepReport:
        """Learn from one batch per process; progress in [0, 1] sets the learning rate."""
        rng = np.random.default_rng([self.plan.seed, self.steps, team.rank])
        generator = torch.Generator().manual_seed(int(rng.integers(2**31)))
        mined = [self.confusions[k] for k in rng.permutation(len(self.confusions))[: self.plan.confusions]]
        batch = pool.draw(rng, groups=self.plan.groups, pairs_per_group=self.plan.pairs_per_group, confusions=mined)
        for group in self.optimiser.param_groups:
            group["lr"] = self.plan.rate * schedule(progress, self.plan.warm_up)
        self.network.train()
        self.optimiser.zero_grad(set_to_none=True)
        loss, total, pairs = self._losses(batch, precision, rng, generator)
        total.backward()
        team.average_gradients(self.network)
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), 2.0)
        self.optimiser.step()
        self.steps += 1
        self.pairs += pairs * team.size
        self._update_average()
        return StepReport(loss.item(), total.item())

    def _losses(
        self, batch: Batch, precision: Precision, rng: np.random.Generator, generator: torch.Generator
    ) -> tuple[Tensor, Tensor, int]:
        """Return Eq. 1, the total, and the number of pairs."""
        features, mirrored = self._encode(batch, precision, rng, generator)
        sources, targets, reachable = self._pairs(batch, self.network.rough_logits(features).detach(), generator)
        waypoints = torch.from_numpy(batch.waypoints(sources.numpy(), targets.numpy())).float()
        if mirrored:
            waypoints = waypoints * torch.tensor([1.0, -1.0, -1.0])
        here, there = features.take(sources), features.take(targets)
        output = precision.compare(self.network, here, there)
        plan = self.plan
        loss = pair_loss(output.logit, output.pose, reachable, waypoints, alpha=plan.alpha, beta=plan.beta)
        scene = torch.from_numpy(batch.scene)
        known = self._known_labels(batch, sources, targets, reachable)
        seen = Compared(features, here, there, output, waypoints, scene[sources] == scene[targets], known)
        weights = {"matching": plan.matching, "place": plan.place}
        extra = [weights[name] * term for name, term in self.network.auxiliary_losses(seen).items()]
        return loss, loss + sum(extra), len(sources)

    def _encode(
        self, batch: Batch, precision: Precision, rng: np.random.Generator, generator: torch.Generator
    ) -> tuple[Encoded, bool]:
        rgb, depth = images_to_tensors(batch.rgb, batch.depth_mm / np.float32(1000))
        rgb, depth = augment(rgb, depth, torch.from_numpy(batch.scene), self.plan.augmentation, generator)
        if mirrored := bool(rng.random() < 0.5):
            rgb, depth = mirror(rgb, depth)
        return precision.encode(self.network, rgb, depth), mirrored

    def _pairs(self, batch: Batch, rough: Tensor, generator: torch.Generator) -> tuple[Tensor, Tensor, Tensor]:
        """Return sources, targets and labels (P,) of the batch's pairs and of further far ones."""
        far = self._far(batch)
        hard = hardest(rough, far, self.plan.hard, generator)
        same_scene = torch.from_numpy(batch.scene[:, None] == batch.scene[None, :])
        random = hardest(torch.zeros_like(rough), far & same_scene, self.plan.random, generator)
        sources = torch.cat([torch.from_numpy(batch.sources), hard[0], random[0]])
        targets = torch.cat([torch.from_numpy(batch.targets), hard[1], random[1]])
        labels = torch.zeros(len(sources))
        labels[: len(batch.sources)] = torch.from_numpy(batch.reachable).float()
        return sources, targets, labels

    def _far(self, batch: Batch) -> Tensor:
        """Return (B, B): pairs that are certainly not reachable, also those of different scenes."""
        if batch.apart is not None:
            return torch.from_numpy(batch.apart)
        foreign = batch.scene[:, None] != batch.scene[None, :]
        return torch.from_numpy(foreign | self.plan.far.pairs(batch.poses, batch.poses))

    def _known_labels(self, batch: Batch, sources: Tensor, targets: Tensor, reachable: Tensor) -> Tensor:
        """Return (B, B): 1 reachable, 0 not, nan unknown."""
        labels = torch.full((len(batch.rgb), len(batch.rgb)), torch.nan)
        labels[self._far(batch)] = 0.0
        labels[sources, targets] = reachable
        return labels

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
