"""Finds what the network confuses: far pairs of training images that it calls reachable.

Owns the search. The confusions go back into training as hard negatives.
"""

from dataclasses import dataclass
from math import radians

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ltvn_core.geometry import wrap_angle
from ltvn_core.model.contract import Network
from ltvn_core.model.device import device_of, to_tensor
from ltvn_core.model.examples import Confusion, Examples
from ltvn_core.model.features import Kept, join
from ltvn_core.model.precision import Precision
from ltvn_core.model.predictor import images_to_tensors
from ltvn_core.types import Pose


@dataclass(frozen=True, slots=True)
class Far:
    """Pairs that are negatives whatever stands between them (ours; safely beyond the limits of reachability)."""

    distance_m: float = 3.0
    """Farther apart than this,"""
    yaw_rad: float = radians(92)
    """or turned by more than this."""

    def pairs(self, sources: Pose, targets: Pose) -> NDArray[np.bool_]:
        """Return (S, T): which of sources (S, 3) and targets (T, 3) are far from each other."""
        shift = sources[:, None, :2] - targets[None, :, :2]
        turn = np.abs(wrap_angle(sources[:, None, 2] - targets[None, :, 2]))
        return (np.hypot(shift[..., 0], shift[..., 1]) > self.distance_m) | (turn > self.yaw_rad)


def find_confusions(
    network: Network[Kept],
    precision: Precision,
    scene: Examples,
    scene_number: int,
    far: Far,
    rng: np.random.Generator,
    *,
    images: int = 1000,
    candidates: int = 1000,
    above: float = 0.03,
) -> list[Confusion]:
    """Return the far pairs among some images of a scene that the network calls reachable, worst first.

    Only the `candidates` pairs with the best rough scores are compared in full; ties are broken at random.
    """
    rows = rng.choice(len(scene.poses), min(images, len(scene.poses)), replace=False)
    apart = far.pairs(scene.poses[rows], scene.poses[rows])
    return confusions_among(
        network, precision, scene, scene_number, rows, apart, rng, candidates=candidates, above=above
    )


@torch.no_grad()
def confusions_among(
    network: Network[Kept],
    precision: Precision,
    scene: Examples,
    scene_number: int,
    rows: NDArray[np.intp],
    apart: NDArray[np.bool_],
    rng: np.random.Generator,
    *,
    candidates: int = 1000,
    above: float = 0.03,
) -> list[Confusion]:
    """Return those of some images' far pairs that the network calls reachable, worst first; `apart` is (N, N)."""
    features = _encode(network, precision, scene, rows)
    scores = network.rough_logits(features)
    scores[to_tensor(~apart, scores.device)] = -torch.inf
    shuffled = to_tensor(rng.permutation(scores.numel()), scores.device)
    best = shuffled[scores.flatten()[shuffled].topk(min(candidates, int(apart.sum()))).indices]
    sources, targets = best // len(rows), best % len(rows)
    logits = torch.cat(
        [
            precision.compare(network, features.take(i), features.take(j)).logit
            for i, j in zip(sources.split(256), targets.split(256), strict=True)
        ]
    )
    reachability = network.reachability(logits)
    order = torch.argsort(reachability, descending=True)
    order = order[reachability[order] > above]
    return [Confusion(scene_number, int(rows[sources[k]]), int(rows[targets[k]])) for k in order.tolist()]


def _encode(network: Network[Kept], precision: Precision, scene: Examples, rows: NDArray[np.intp]) -> Kept:
    parts: list[Kept] = []
    for part in np.array_split(rows, max(len(rows) // 128, 1)):
        rgb, depth = images_to_tensors(scene.rgb[part], scene.depth_mm[part] / np.float32(1000), device_of(network))
        parts.append(precision.encode(network, rgb, depth))
    return join(parts)


def hardest(
    scores: Tensor, allowed: Tensor, count: int, generator: torch.Generator, hardness: float = 1.5
) -> tuple[Tensor, Tensor]:
    """Return rows and columns of the `count` highest scores (B, B) among the allowed, shaken so that they vary.

    With a hardness of 0 all the allowed have the same chance.
    """
    chance = torch.rand(scores.shape, generator=generator, device=scores.device)
    noise = -torch.log(-torch.log(chance.clamp(1e-9, 1 - 1e-7)))
    shaken = (hardness * scores + noise).masked_fill(~allowed, -torch.inf)
    best = shaken.flatten().topk(min(count, int(allowed.sum()))).indices
    return best // scores.shape[1], best % scores.shape[1]
