"""Hard-negative mining: finds far pairs of training images that the network predicts as reachable.

Plans and trainers call them `confusions`, a name that is stored in model cards.
"""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ltvn_core.network.base_network import BaseNetwork, MixedPrecision
from ltvn_core.network.device import device_of, to_tensor
from ltvn_core.network.image_features import FeaturesT, join
from ltvn_core.network.predictor import images_to_tensors
from ltvn_core.network.training_examples import FarCriterion, HardNegative, SceneExamples

_COMPARED, _LEAST_REACHABILITY = 1000, 0.03
"""Number of pairs of a scene that are compared in full, and the least r of those that are kept."""


def mine_hard_negatives(
    network: BaseNetwork[FeaturesT],
    precision: MixedPrecision,
    scene: SceneExamples,
    scene_number: int,
    far: FarCriterion,
    rng: np.random.Generator,
    *,
    images: int = 1000,
) -> list[HardNegative]:
    """Return the far pairs among some images of a scene that the network predicts as reachable, highest r first."""
    rows = rng.choice(len(scene.poses), min(images, len(scene.poses)), replace=False)
    apart = far.pairs(scene.poses[rows], scene.poses[rows])
    return hard_negatives_among(network, precision, scene, scene_number, rows, apart, rng)


@torch.no_grad()
def hard_negatives_among(
    network: BaseNetwork[FeaturesT],
    precision: MixedPrecision,
    scene: SceneExamples,
    scene_number: int,
    rows: NDArray[np.intp],
    apart: NDArray[np.bool_],
    rng: np.random.Generator,
) -> list[HardNegative]:
    """Return the pairs marked in `apart` (N, N) that the network predicts as reachable, highest r first.

    Only those with the best rough scores are compared in full; ties are broken at random.
    """
    parts: list[FeaturesT] = []
    for part in np.array_split(rows, max(len(rows) // 128, 1)):
        rgb, depth = images_to_tensors(scene.rgb[part], scene.depth_mm[part] / np.float32(1000), device_of(network))
        parts.append(precision.encode(network, rgb, depth))
    features = join(parts)
    scores = network.rough_logits(features)
    scores[to_tensor(~apart, scores.device)] = -torch.inf
    shuffled = to_tensor(rng.permutation(scores.numel()), scores.device)
    best = shuffled[scores.flatten()[shuffled].topk(min(_COMPARED, int(apart.sum()))).indices]
    sources = best // len(rows)
    targets = best % len(rows)
    logits = torch.cat(
        [
            precision.compare(network, features.take(i), features.take(j)).logit
            for i, j in zip(sources.split(256), targets.split(256), strict=True)
        ]
    )
    reachability = network.reachability(logits)
    order = torch.argsort(reachability, descending=True)
    order = order[reachability[order] > _LEAST_REACHABILITY]
    return [HardNegative(scene_number, int(rows[sources[k]]), int(rows[targets[k]])) for k in order.tolist()]


def sample_hardest(
    scores: Tensor, allowed: Tensor, count: int, generator: torch.Generator, hardness: float = 1.5
) -> tuple[Tensor, Tensor]:
    """Return rows and columns of the `count` highest scores (B, B) among the allowed ones, with random noise added.

    With a hardness of 0 all allowed entries are equally likely.
    """
    chance = torch.rand(scores.shape, generator=generator, device=scores.device)
    # Gumbel noise: the largest noisy scores are a sample without replacement with odds exp(hardness * score).
    noise = -torch.log(-torch.log(chance.clamp(1e-9, 1 - 1e-7)))
    noisy = (hardness * scores + noise).masked_fill(~allowed, -torch.inf)
    best = noisy.flatten().topk(min(count, int(allowed.sum()))).indices
    return best // scores.shape[1], best % scores.shape[1]
