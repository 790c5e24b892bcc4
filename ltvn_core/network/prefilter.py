"""Which of many targets are worth a full comparison with one source: a quick look at a few of their tokens.

Owns this rough score. It says how much of the source seems to appear in a target at all, whatever the geometry.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from ltvn_core.network.architecture import PairArchitecture
from ltvn_core.network.image_features import ImageFeatures

SOURCE_TOKENS = 32
"""So many of the source's tokens are looked for, those that most readily find a match."""

TARGET_STEP = 2
"""They are looked for among every second token of each second row of the targets."""


class PrefilterScores(NamedTuple):
    """What a quick look says of one source and each of T targets."""

    logit: Tensor
    """(T,) rough logits of reachability."""
    similarity: Tensor
    """(T,) how much is to be gained from a full comparison."""


def coarse_descriptors(rows: Tensor, size: PairArchitecture) -> Tensor:
    """Return (N, M, D): descriptors of a quarter of the tokens, from feature rows (N, F)."""
    descriptors = rows[:, : size.token_count * size.descriptor]  # They come first in a row.
    grid = descriptors.reshape(len(rows), *size.grid, size.descriptor)
    return grid[:, ::TARGET_STEP, ::TARGET_STEP].float().reshape(len(rows), -1, size.descriptor)


def similarity(source: ImageFeatures, targets: Tensor, sharpness: Tensor) -> Tensor:
    """Return (N,): the share of one source's surest tokens that seem to appear in targets (N, M, D)."""
    surest = source.unmatched[0].topk(min(SOURCE_TOKENS, source.unmatched.shape[1]), largest=False)
    likeness = source.descriptors[0, surest.indices] @ targets.flatten(0, 1).T
    best = likeness.reshape(len(surest.indices), *targets.shape[:2]).amax(2)
    return torch.sigmoid(sharpness * best - surest.values[:, None]).mean(0)
