"""The trainer: a network, the moving average of its weights and an optimiser, updated by steps, and checkpoints.

Training, fine-tuning and the training of rivals are its loop of steps with callbacks between the steps. A trainer that
starts from trained weights keeps their statistics of batch normalisation. A checkpoint is a safetensors file with the
state of the trainer and the time spent; everything else follows from the plan.
"""

import json
import math
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor, nn

from ltvn_core.atomic_files import atomic_replacement
from ltvn_core.errors import WeightsError
from ltvn_core.network.architecture import AnyArchitecture, PairArchitecture
from ltvn_core.network.base_network import FLOAT32, AnyNetwork, ComparedBatch, MixedPrecision
from ltvn_core.network.device import CPU, to_tensor
from ltvn_core.network.loss import pair_loss
from ltvn_core.network.network_families import build_network
from ltvn_core.network.optimization.augmentation import Augmentation, augment, mirror
from ltvn_core.network.optimization.hard_negative_mining import sample_hardest
from ltvn_core.network.optimization.scene_images import SceneImages
from ltvn_core.network.training_examples import BatchSampler, FarCriterion, HardNegative, TrainingBatch


@dataclass(frozen=True, slots=True)
class Hyperparameters:
    """Hyperparameters of a training step (all values are ours; the paper states none).

    The names of the fields are stored in model cards.
    """

    seed: int = 0
    """Seed of the initial weights, the batches and the augmentation."""
    alpha: float = 3.0
    """Weight of the position error in Eq. 1."""
    beta: float = 3.0
    """Weight of the yaw error in Eq. 1."""
    matching: float = 0.15
    """Weight of the auxiliary loss on token matches, in networks that match."""
    place: float = 0.1
    """Weight of the auxiliary loss on the cheap place score, in networks that have one."""
    groups: int = 10
    """Number of image clusters per step."""
    pairs_per_group: int = 18
    """Number of labelled pairs per cluster."""
    evened: bool = True
    """Whether to draw positives uniformly over distance, and as many negatives; False draws pairs as often as they
    occur."""
    confusions: int = 2
    """Number of mined hard negatives per step; the clusters of both images are added to the batch."""
    hard: int = 40
    """Number of far pairs per step with high rough scores; they are random if the network has no rough score."""
    hardness: float = 1.5
    """Preference for high scores, as the inverse temperature of the draw; 0 draws uniformly."""
    random: int = 12
    """Number of far pairs per step drawn at random."""
    rate: float = 2e-3
    """Peak learning rate of AdamW."""
    warm_up: float = 0.03
    """Share of training for the linear warm-up of the learning rate."""
    decay: float = 0.01
    """Weight decay."""
    average: float = 0.998
    """Decay of the moving average of the weights per step."""
    far: FarCriterion = field(default_factory=FarCriterion)
    """Limits beyond which a pair is certainly a negative."""
    augmentation: Augmentation = field(default_factory=Augmentation)
    """Augmentation of the images."""


@dataclass(frozen=True, slots=True)
class StepLosses:
    """The losses of one step."""

    loss: float
    """Eq. 1 without the auxiliary terms."""
    total: float
    """The loss with the auxiliary terms."""


class Trainer:
    """Network, averaged weights and optimiser; an interrupted training repeats the same steps after resuming."""

    def __init__(
        self,
        plan: Hyperparameters,
        size: AnyArchitecture | None = None,
        device: torch.device = CPU,
        *,
        start: AnyNetwork | None = None,
        precision: MixedPrecision = FLOAT32,
    ) -> None:
        """Begin with random weights of a size, or with those of `start`, whose size replaces the given one."""
        self.plan = plan
        self.precision = precision
        self.device = device
        torch.manual_seed(plan.seed)
        size = start.size if start else size or PairArchitecture()
        self.network = build_network(size).to(device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.average = build_network(size).to(device).eval()
        if start:
            self.network.load_state_dict(start.state_dict())
        self.average.load_state_dict(self.network.state_dict())
        self.optimiser = torch.optim.AdamW(self.network.parameters(), plan.rate, weight_decay=plan.decay)
        self.steps = 0
        self.pairs = 0
        self.confusions: list[HardNegative] = []
        self._freezes = start is not None
        self._images: SceneImages | None = None

    def step(self, sampler: BatchSampler, progress: float) -> StepLosses:
        """Update the weights with one batch; progress in [0, 1] sets the learning rate."""
        rng = np.random.default_rng([self.plan.seed, self.steps, 0])
        generator = torch.Generator(self.device).manual_seed(int(rng.integers(2**31)))
        mined = [self.confusions[k] for k in rng.permutation(len(self.confusions))[: self.plan.confusions]]
        batch = sampler.draw(rng, groups=self.plan.groups, pairs_per_group=self.plan.pairs_per_group, confusions=mined)
        for group in self.optimiser.param_groups:
            group["lr"] = self.plan.rate * learning_rate_schedule(progress, self.plan.warm_up)
        self.network.train()
        if self._freezes:
            freeze_batch_norm(self.network)
        self.optimiser.zero_grad(set_to_none=True)
        if self._images is None or self._images.scenes is not sampler.image_scenes:
            self._images = SceneImages(sampler.image_scenes, self.device)
        loss, total, pairs = self._losses(batch, self._images, rng, generator)
        total.backward()
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), 2.0)
        self.optimiser.step()
        self.steps += 1
        self.pairs += pairs
        self._update_average()
        return StepLosses(loss.item(), total.item())

    def _losses(
        self, batch: TrainingBatch, images: SceneImages, rng: np.random.Generator, generator: torch.Generator
    ) -> tuple[Tensor, Tensor, int]:
        """Return the loss of Eq. 1, the total loss with the auxiliary terms, and the number of pairs."""
        plan = self.plan
        scene = to_tensor(batch.scene, self.device)
        rgb, depth = augment(*images.take(batch.images), scene, plan.augmentation, generator)
        if mirrored := bool(rng.random() < 0.5):
            rgb, depth = mirror(rgb, depth)
        features = self.precision.encode(self.network, rgb, depth)
        far = to_tensor(batch.far_apart(plan.far), self.device)
        # Detached, so that no gradient reaches the score through the choice of hard pairs.
        rough = self.network.rough_logits(features).detach()
        sources, targets, reachable = self._pairs(batch, rough, far, scene[:, None] == scene[None, :], generator)
        true = batch.waypoints(sources.cpu().numpy(), targets.cpu().numpy())
        waypoints = to_tensor(true * [1, -1, -1] if mirrored else true, self.device).float()
        source_features = features.take(sources)
        target_features = features.take(targets)
        output = self.precision.compare(self.network, source_features, target_features)
        doubt = self.network.reachability_loss(output.logit, reachable)
        loss = pair_loss(doubt, output.pose, reachable, waypoints, alpha=plan.alpha, beta=plan.beta)
        known = torch.full(far.shape, torch.nan, device=self.device)
        known[far] = 0.0
        known[sources, targets] = reachable
        compared = ComparedBatch(
            features, source_features, target_features, output, waypoints, scene[sources] == scene[targets], known
        )
        weights = {"matching": plan.matching, "place": plan.place}
        extra = [weights[name] * term for name, term in self.network.auxiliary_losses(compared).items()]
        return loss, loss + sum(extra), len(sources)

    def _pairs(
        self, batch: TrainingBatch, rough: Tensor, far: Tensor, same_scene: Tensor, generator: torch.Generator
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Return sources, targets and labels (P,) of the batch's pairs and of additional far pairs."""
        hard = sample_hardest(rough, far, self.plan.hard, generator, self.plan.hardness)
        # Random pairs are drawn within a scene, because pairs of different scenes are easy.
        random = sample_hardest(torch.zeros_like(rough), far & same_scene, self.plan.random, generator)
        sources = torch.cat([to_tensor(batch.sources, self.device), hard[0], random[0]])
        targets = torch.cat([to_tensor(batch.targets, self.device), hard[1], random[1]])
        labels = torch.zeros(len(sources), device=self.device)
        labels[: len(batch.sources)] = to_tensor(batch.reachable, self.device).float()
        return sources, targets, labels

    @torch.no_grad()
    def _update_average(self) -> None:
        # In the first steps the average forgets faster. Otherwise the random initial weights would stay in it for long.
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


def freeze_batch_norm(network: nn.Module) -> None:
    """Make batch normalisation use its stored statistics until the next `train()`.

    The images of one drive are too uniform for new estimates.
    """
    for module in network.modules():
        if isinstance(module, nn.BatchNorm2d):
            module.eval()


SCHEMA = "ltvn-checkpoint-1"
"""Name of the file format; files of another format are refused."""


def save_checkpoint(trainer: Trainer, path: Path, *, seconds: float) -> None:
    """Write the state of a trainer. Raises WeightsError if it cannot be written; the old file then stays."""
    metadata = {
        "schema": SCHEMA,
        "plan": _plan_text(trainer),
        "steps": str(trainer.steps),
        "pairs": str(trainer.pairs),
        "seconds": repr(seconds),
    }
    try:
        with atomic_replacement(path) as part:
            save_file(_tensors(trainer), part, metadata)
    except (OSError, SafetensorError) as error:
        raise WeightsError(f"{path}: the checkpoint could not be written ({error}); free some space.") from error


def restore_checkpoint(trainer: Trainer, path: Path) -> float:
    """Restore the state of a checkpoint in a new trainer of the same plan, and return the seconds spent before.

    Raises WeightsError for a file that is truncated, of another format, or of another plan.
    """
    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (no mapping)
    except (OSError, SafetensorError) as error:
        raise WeightsError(f"{path}: not a complete checkpoint ({error}); delete it to start over.") from error
    if metadata.get("schema") != SCHEMA or metadata.get("plan") != _plan_text(trainer):
        raise WeightsError(f"{path}: made with other training settings; name another folder or delete it.")
    trainer.network.load_state_dict(_part(tensors, "network."))
    trainer.average.load_state_dict(_part(tensors, "average."))
    trainer.steps = int(metadata["steps"])
    trainer.pairs = int(metadata["pairs"])
    trainer.confusions = [HardNegative(*row) for row in tensors["confusions"].tolist()]
    state: dict[int, dict[str, Tensor]] = {}
    for name, value in _part(tensors, "optimiser.").items():
        number, field = name.split(".", 1)
        state.setdefault(int(number), {})[field] = value
    trainer.optimiser.load_state_dict({**trainer.optimiser.state_dict(), "state": state})
    return float(metadata["seconds"])


def _tensors(trainer: Trainer) -> dict[str, Tensor]:
    state = {f"network.{name}": value for name, value in trainer.network.state_dict().items()}
    state |= {f"average.{name}": value for name, value in trainer.average.state_dict().items()}
    for number, entry in trainer.optimiser.state_dict()["state"].items():
        state |= {f"optimiser.{number}.{name}": torch.as_tensor(value) for name, value in entry.items()}
    state["confusions"] = torch.tensor(trainer.confusions, dtype=torch.int64).reshape(-1, 3)
    return {name: value.detach().cpu().clone(memory_format=torch.contiguous_format) for name, value in state.items()}


def _part(tensors: dict[str, Tensor], prefix: str) -> dict[str, Tensor]:
    return {name.removeprefix(prefix): value for name, value in tensors.items() if name.startswith(prefix)}


def _plan_text(trainer: Trainer) -> str:
    return json.dumps([asdict(trainer.plan), asdict(trainer.network.size)], sort_keys=True)


_CHECKPOINT_EVERY_S = 30.0
_NEWEST_SHARE = 0.05
"""Weight of the last step in the smoothed loss (exponential moving average)."""


class LearningLoop:
    """One training or fine-tuning run; a checkpoint in its folder is resumed."""

    def __init__(
        self, trainer: Trainer, sampler: BatchSampler, folder: Path, *, minutes: float | None, steps: int
    ) -> None:
        """Learn for `minutes`, or for `steps` if `minutes` is None. Raises WeightsError for an unusable checkpoint."""
        self.trainer = trainer
        self._sampler = sampler
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
            losses = self.trainer.step(self._sampler, before)
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
