"""The training loss: Eq. 1 of the paper, and two auxiliary terms of ours that speed up the learning of matches.

The weights of the terms are in `ltvn_core.network.optimization.trainer.Hyperparameters`.
"""

import math
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from ltvn_core.network.image_features import ImageFeatures
from ltvn_core.network.pair_head import PlanarMotion, TokenMatching

_OPPOSITE_COS = -0.17
"""Cosine of a turn of about 100 degrees. Images with a larger turn share no surface: their close points are on opposite
sides of a wall."""


def pair_loss(
    reachability_loss: Tensor, pose: Tensor, reachable: Tensor, waypoints: Tensor, *, alpha: float, beta: float
) -> Tensor:
    """Return Eq. 1, the mean over P pairs of L_r + r (alpha L_p + beta L_theta).

    L_r (P,) is the network's own loss of its logit against r (P,), L_p the Euclidean norm (not squared) of the error in
    (dx, dy), and L_theta = |sin - sin^| + |cos - cos^|. Pose (P, 4) is dx, dy, sin, cos; waypoints are (P, 3).
    """
    # The small term keeps the gradient of the root finite at zero error.
    position = torch.sqrt((pose[:, :2] - waypoints[:, :2]).square().sum(1) + 1e-9)
    turn = waypoints[:, 2]
    angle = (pose[:, 2] - torch.sin(turn)).abs() + (pose[:, 3] - torch.cos(turn)).abs()
    return (reachability_loss + reachable * (alpha * position + beta * angle)).mean()


def cross_entropy(logit: Tensor, reachable: Tensor) -> Tensor:
    """Return (P,) the binary cross-entropy of logits (P,) against r (P,), as in the paper."""
    return functional.binary_cross_entropy_with_logits(logit, reachable, reduction="none")


def contrastive_loss(logit: Tensor, reachable: Tensor, *, negatives: int) -> Tensor:
    """Return the InfoNCE loss (P,) of each reachable pair against `negatives` unreachable ones, 0 for the latter.

    Instead of drawing negatives, all unreachable pairs of the batch are weighted as if they were `negatives` pairs. The
    scale makes the mean over all pairs equal to the mean over the reachable ones.
    """
    positive = reachable > 0.5
    count = int(positive.sum())
    others = logit[~positive]
    if not count or not len(others):
        return logit * 0
    against = torch.logsumexp(others, 0) + math.log(negatives / len(others))
    return functional.softplus(against - logit) * positive * (len(logit) / count)


class TokenCorrespondence(NamedTuple):
    """Ground-truth matches: the tokens of P pairs that show the same surface."""

    pair: Tensor
    """(M,) rows of the matched token pairs."""
    source: Tensor
    """(M,) source tokens of the matches."""
    target: Tensor
    """(M,) target tokens of the matches."""
    unmatched_source: Tensor
    """(P, T) source tokens that have no counterpart."""
    unmatched_target: Tensor
    """(P, T) target tokens that have no counterpart."""


@torch.no_grad()
def true_correspondence(
    source: ImageFeatures, target: ImageFeatures, waypoints: Tensor, same_scene: Tensor
) -> TokenCorrespondence:
    """Match tokens that are mutual nearest neighbours and close enough in space, from true waypoints (P, 3).

    Tokens that are near to another one but not its nearest neighbour are neither matched nor unmatched.
    """
    cos = torch.cos(waypoints[:, 2])
    sin = torch.sin(waypoints[:, 2])
    there = PlanarMotion(waypoints[:, :2], torch.stack([cos, sin], dim=-1)).apply(target.points)
    apart = torch.cdist(source.points, there)
    no_depth = (source.points[..., 0] <= 0)[..., None] | (target.points[..., 0] <= 0)[:, None]
    no_common_surface = ~same_scene | (cos < _OPPOSITE_COS)
    apart = apart.masked_fill(no_depth | no_common_surface[:, None, None], 1e3)
    nearest_target = apart.min(2)
    nearest_source = apart.min(1)
    # A token covers more surface at a distance, so the tolerance grows with depth.
    tolerance_source, tolerance_target = (0.05 + 0.07 * side.points[..., 0] for side in (source, target))
    tokens = torch.arange(apart.shape[1], device=apart.device)
    mutual = torch.gather(nearest_source.indices, 1, nearest_target.indices) == tokens
    pair, token = torch.nonzero(mutual & (nearest_target.values < tolerance_source), as_tuple=True)
    return TokenCorrespondence(
        pair=pair,
        source=token,
        target=nearest_target.indices[pair, token],
        unmatched_source=nearest_target.values > 2 * tolerance_source,
        unmatched_target=nearest_source.values > 2 * tolerance_target,
    )


def matching_loss(matching: TokenMatching, true: TokenCorrespondence) -> Tensor:
    """Return the mean negative log-likelihood of matches and of "no match" (auxiliary, ours)."""
    at = (true.pair, true.source, true.target)
    rows = matching.row_total[at[0], at[1]]
    columns = matching.column_total[at[0], at[2]]
    matched = (rows.log() + columns.log()) / 2 - matching.strength[at].clamp(min=1e-30).log()
    unmatched = torch.cat(
        [
            (matching.row_total / matching.row_unmatched)[true.unmatched_source].log(),
            (matching.column_total / matching.column_unmatched)[true.unmatched_target].log(),
        ]
    )
    return matched.sum() / max(len(matched), 1) + unmatched.sum() / max(len(unmatched), 1)


def place_loss(logits: Tensor, labels: Tensor) -> Tensor:
    """Return the cross-entropy of the cheap place scores (B, B) where labels are 0 or 1; nan is unknown (auxiliary)."""
    known = torch.isfinite(labels)
    positive = known & (labels > 0.5)
    negative = known & (labels < 0.5)
    # Positives and negatives are averaged separately, because negatives are many times as frequent.
    positive_loss = functional.softplus(-logits[positive]).mean() if positive.any() else logits.sum() * 0
    negative_loss = functional.softplus(logits[negative]).mean() if negative.any() else logits.sum() * 0
    return positive_loss + negative_loss
