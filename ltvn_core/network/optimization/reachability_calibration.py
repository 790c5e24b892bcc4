"""Makes r honest after training and again after fine-tuning, on pairs that were not learned from.

Owns which pairs count how much. The fit is in `ltvn_core.network.optimization.platt_scaling`.
"""

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray

from ltvn_core.network.base_network import AnyNetwork
from ltvn_core.network.metrics.pair_evaluation import encode_images, predict_pairs
from ltvn_core.network.optimization.mixed_batches import LabelledTrajectory
from ltvn_core.network.optimization.platt_scaling import fit_platt, logit
from ltvn_core.network.predictor import NetworkPredictor
from ltvn_core.network.training_examples import SceneExamples

PairSelection: TypeAlias = tuple[SceneExamples, NDArray[np.intp]]
"""A scene, and the rows of the labelled pairs of it that count."""


def calibrate_after_fine_tuning(
    network: AnyNetwork, drive: LabelledTrajectory, scenes: Sequence[SceneExamples], *, most: int = 10_000
) -> None:
    """Fit the network's calibration on simulated validation pairs and on the part of the drive that was held out.

    The drive lacks the pairs about which odometry is unsure, and they are the hard ones. So it never counts more than
    simulation does, where that is at hand. Of a short drive nothing is held out; where there is no simulation either,
    the calibration stays as it is.
    """
    rng = np.random.default_rng(0)
    judged: list[PairSelection] = [(scene, rng.permutation(len(scene.sources))[:most]) for scene in scenes]
    limit = sum(len(pairs) for _, pairs in judged) if judged else most
    kept_back = np.flatnonzero(drive.held_out[drive.sources] & drive.held_out[drive.targets])
    if len(kept_back):
        judged.append((drive, rng.permutation(kept_back)[:limit]))
    if judged:
        calibrate_reachability(network, judged)


def calibrate_reachability(network: AnyNetwork, chosen: Sequence[PairSelection]) -> None:
    """Fit the network's calibration on chosen labelled pairs of scenes."""
    network.calibration.copy_(torch.tensor([1.0, 0.0]))
    judged = [_logits_and_labels(network, scene, pairs) for scene, pairs in chosen]
    logits, positive = (np.concatenate(column) for column in zip(*judged, strict=True))
    network.calibration.copy_(torch.tensor(fit_platt(logits, positive)))


def _logits_and_labels(
    network: AnyNetwork, scene: SceneExamples, pairs: NDArray[np.intp]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return logits and labels of some labelled pairs."""
    predictor = NetworkPredictor(network, "in calibration")
    rows, at = np.unique(np.concatenate([scene.sources[pairs], scene.targets[pairs]]), return_inverse=True)
    features = encode_images(predictor, scene.rgb[rows], scene.depth_mm[rows])
    found = predict_pairs(predictor, features, at[: len(pairs)], at[len(pairs) :])
    return logit(found.reachability), scene.reachable[pairs]
