"""Networks that add last layers of their own to a trained pair network, of which nothing else changes.

A navigation system that needs labels or a loss of its own gets them for a few kilobytes; the pose estimator stays the
same one. `ltvn_core.network.weights_file` keeps the added layers alone.
"""

from typing import Self

import torch
from torch import Tensor, nn

from ltvn_core.network.architecture import ContrastiveArchitecture, EnsembleArchitecture
from ltvn_core.network.base_network import ComparedBatch
from ltvn_core.network.image_features import ImageFeatures
from ltvn_core.network.loss import contrastive_loss
from ltvn_core.network.pair_head import PairOutput, summary_length
from ltvn_core.network.pair_network import PairNetwork

NEGATIVES = 50
"""A reachable pair is told from so many that are not; HTM's number."""


class EnsembleNetwork(PairNetwork):
    """Last layers that judge by themselves: each learns from a share of the pairs, and the least sure one counts."""

    def __init__(self, size: EnsembleArchitecture | None = None) -> None:
        size = size or EnsembleArchitecture()
        super().__init__(size)
        self.requires_grad_(False)
        self.members = nn.ModuleList(_last_layers(size) for _ in range(size.members))

    def train(self, mode: bool = True) -> Self:
        """Let the added layers learn; batch normalisation below them keeps its statistics."""
        super().train(mode)
        self.encoder.eval()
        self.head.eval()
        return self

    def compare(self, source: ImageFeatures, target: ImageFeatures) -> PairOutput:
        """Compare P sources with P targets, in float32 whatever precision is set: matching and geometry need it."""
        with torch.autocast(source.points.device.type, enabled=False):
            summary = self.head.summarise(source, target)
            logits = torch.cat([member(summary.numbers) for member in self.members], dim=1)
            return PairOutput(self._judge(logits), self.head.conclude(summary).pose)

    def _judge(self, logits: Tensor) -> Tensor:
        """Return (P,) of logits (P, M): of the least sure member; while learning, of the one whose turn a pair is."""
        if not self.training:
            return logits.min(dim=1).values
        pairs = torch.arange(len(logits), device=logits.device)
        return logits[pairs, pairs % logits.shape[1]]

    def auxiliary_losses(self, compared: ComparedBatch[ImageFeatures]) -> dict[str, Tensor]:
        """Return none: what they would teach does not change."""
        return {}


class ContrastiveNetwork(EnsembleNetwork):
    """One score, which learns to tell a reachable pair from many others (contrastive predictive coding)."""

    def __init__(self, size: ContrastiveArchitecture | None = None) -> None:
        super().__init__(size or ContrastiveArchitecture())

    def reachability_loss(self, logit: Tensor, reachable: Tensor) -> Tensor:
        """Return InfoNCE for P pairs, (P,)."""
        return contrastive_loss(logit, reachable, negatives=NEGATIVES)


def _last_layers(size: EnsembleArchitecture) -> nn.Sequential:
    """Return layers from a summary to a logit."""
    wide, narrow = size.member_hidden, size.member_hidden // 2
    return nn.Sequential(
        nn.Linear(summary_length(size), wide), nn.ReLU(), nn.Linear(wide, narrow), nn.ReLU(), nn.Linear(narrow, 1)
    )
