"""The forward pass of a training step: augments and encodes images, chooses and compares pairs, sums the loss.

It is a module, so that torch's DistributedDataParallel can average the gradients of its backward pass.
"""

import numpy as np
import torch
from torch import Tensor, nn

from ltvn_core.network.base_network import AnyNetwork, ComparedBatch
from ltvn_core.network.device import device_of, to_tensor
from ltvn_core.network.image_features import EncodedImages
from ltvn_core.network.loss import pair_loss
from ltvn_core.network.optimization.augmentation import augment, mirror
from ltvn_core.network.optimization.hard_negative_mining import sample_hardest
from ltvn_core.network.optimization.hyperparameters import Hyperparameters
from ltvn_core.network.optimization.mixed_precision import MixedPrecision
from ltvn_core.network.predictor import images_to_tensors
from ltvn_core.network.training_examples import TrainingBatch


class TrainingStep(nn.Module):
    """The loss of a network on a batch."""

    def __init__(self, network: AnyNetwork, plan: Hyperparameters) -> None:
        super().__init__()
        self.network = network
        self.plan = plan

    def forward(
        self, batch: TrainingBatch, precision: MixedPrecision, rng: np.random.Generator, generator: torch.Generator
    ) -> tuple[Tensor, Tensor, int]:
        """Return Eq. 1, all that is minimised, and the number of pairs."""
        plan = self.plan
        device = device_of(self.network)
        features, mirrored = self._encode(batch, precision, rng, generator)
        # Detached: choosing hard pairs shall not train the score that chooses them.
        sources, targets, reachable = self._pairs(batch, self.network.rough_logits(features).detach(), generator)
        true = batch.waypoints(sources.cpu().numpy(), targets.cpu().numpy())
        waypoints = to_tensor(true * [1, -1, -1] if mirrored else true, device).float()
        source_features = features.take(sources)
        target_features = features.take(targets)
        output = precision.compare(self.network, source_features, target_features)
        doubt = self.network.reachability_loss(output.logit, reachable)
        loss = pair_loss(doubt, output.pose, reachable, waypoints, alpha=plan.alpha, beta=plan.beta)
        scene = to_tensor(batch.scene, device)
        known = self._known_labels(batch, sources, targets, reachable)
        compared = ComparedBatch(
            features, source_features, target_features, output, waypoints, scene[sources] == scene[targets], known
        )
        weights = {"matching": plan.matching, "place": plan.place}
        extra = [weights[name] * term for name, term in self.network.auxiliary_losses(compared).items()]
        return loss, loss + sum(extra), len(sources)

    def _encode(
        self, batch: TrainingBatch, precision: MixedPrecision, rng: np.random.Generator, generator: torch.Generator
    ) -> tuple[EncodedImages, bool]:
        device = device_of(self.network)
        rgb, depth = images_to_tensors(batch.rgb, batch.depth_mm / np.float32(1000), device)
        rgb, depth = augment(rgb, depth, to_tensor(batch.scene, device), self.plan.augmentation, generator)
        if mirrored := bool(rng.random() < 0.5):
            rgb, depth = mirror(rgb, depth)
        return precision.encode(self.network, rgb, depth), mirrored

    def _pairs(self, batch: TrainingBatch, rough: Tensor, generator: torch.Generator) -> tuple[Tensor, Tensor, Tensor]:
        """Return sources, targets and labels (P,) of the batch's pairs and of further far ones."""
        device = rough.device
        far = self._far(batch)
        hard = sample_hardest(rough, far, self.plan.hard, generator, self.plan.hardness)
        same_scene = to_tensor(batch.scene[:, None] == batch.scene[None, :], device)
        # Random ones come from the same scene, because pairs of different scenes are easy.
        random = sample_hardest(torch.zeros_like(rough), far & same_scene, self.plan.random, generator)
        sources = torch.cat([to_tensor(batch.sources, device), hard[0], random[0]])
        targets = torch.cat([to_tensor(batch.targets, device), hard[1], random[1]])
        labels = torch.zeros(len(sources), device=device)
        labels[: len(batch.sources)] = to_tensor(batch.reachable, device).float()
        return sources, targets, labels

    def _far(self, batch: TrainingBatch) -> Tensor:
        """Return (B, B): pairs that are certainly not reachable, also those of different scenes."""
        apart = batch.apart
        if apart is None:
            different_scene = batch.scene[:, None] != batch.scene[None, :]
            apart = different_scene | self.plan.far.pairs(batch.poses, batch.poses)
        return to_tensor(apart, device_of(self.network))

    def _known_labels(self, batch: TrainingBatch, sources: Tensor, targets: Tensor, reachable: Tensor) -> Tensor:
        """Return (B, B): 1 reachable, 0 not, nan unknown."""
        labels = torch.full((len(batch.rgb), len(batch.rgb)), torch.nan, device=reachable.device)
        labels[self._far(batch)] = 0.0
        labels[sources, targets] = reachable
        return labels
