"""The prefilter: a cheap score of one source with many targets, from a few of their tokens.

It estimates how much of the source appears in a target, without geometry.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from ltvn_core.network.architecture import PairArchitecture
from ltvn_core.network.image_features import ImageFeatures

SOURCE_TOKENS = 32
"""Number of source tokens that are matched, those with the lowest score of having no match."""

TARGET_STEP = 2
"""They are matched with every second token of every second row of the targets."""


SCREENING_CUT = 0.1
_PLACE_SHARE = 0.03
"""A pair is worth a full comparison if its similarity and so much of its place logit reach the cut. On drives through
tune-0 and tune-office-0 that holds for 18 and 38 % of all pairs, and for 100 and 99 % of those with r > 0.6 and
d < 1."""


class PrefilterScores(NamedTuple):
    """Cheap scores of one source with each of T targets."""

    logit: Tensor
    """(T,) rough logits of reachability."""
    similarity: Tensor
    """(T,) score by which targets are chosen for a full comparison."""

    def may_match(self) -> Tensor:
        """Return (T,): which targets are worth a full comparison at all."""
        return self.similarity + _PLACE_SHARE * self.logit >= SCREENING_CUT


def coarse_descriptors(rows: Tensor, size: PairArchitecture) -> Tensor:
    """Return (N, M, D): descriptors of a quarter of the tokens, from feature rows (N, F)."""
    descriptors = rows[:, : size.token_count * size.descriptor]  # They come first in a row.
    grid = descriptors.reshape(len(rows), *size.grid, size.descriptor)
    return grid[:, ::TARGET_STEP, ::TARGET_STEP].float().reshape(len(rows), -1, size.descriptor)


def similarity(source: ImageFeatures, targets: Tensor, sharpness: Tensor) -> Tensor:
    """Return the share (N,) of the best tokens of one source that appear in targets (N, M, D)."""
    surest = source.unmatched[0].topk(min(SOURCE_TOKENS, source.unmatched.shape[1]), largest=False)
    likeness = source.descriptors[0, surest.indices] @ targets.flatten(0, 1).T
    best = likeness.reshape(len(surest.indices), *targets.shape[:2]).amax(2)
    return torch.sigmoid(sharpness * best - surest.values[:, None]).mean(0)
