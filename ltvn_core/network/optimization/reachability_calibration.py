"""Calibrates the reachability of a network after training and after fine-tuning, on held-out pairs (Platt scaling).

The scale and offset of the logits are kept in the network's `calibration` buffer.
"""

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import expit

from ltvn_core.network.base_network import AnyNetwork
from ltvn_core.network.pair_evaluation import compare_labelled
from ltvn_core.network.predictor import NetworkPredictor
from ltvn_core.network.training_data.trajectory_pairs import TrajectoryPairs
from ltvn_core.network.training_examples import SceneExamples

PairSelection: TypeAlias = tuple[SceneExamples, NDArray[np.intp]]
"""A scene and the rows of the labelled pairs to use."""

_MOST_PAIRS = 10_000
"""Largest number of pairs of each scene, drawn at random."""


def calibrate_after_fine_tuning(network: AnyNetwork, drive: TrajectoryPairs, scenes: Sequence[SceneExamples]) -> None:
    """Fit the network's calibration on simulated validation pairs and on the part of the drive that was held out.

    The drive lacks the hard pairs, because odometry cannot label them. So at most as many pairs of the drive are used
    as simulated ones, if there are any. A short drive has no held-out pairs; without simulated pairs the calibration
    then stays unchanged.
    """
    rng = np.random.default_rng(0)
    selections: list[PairSelection] = [(scene, rng.permutation(len(scene.sources))[:_MOST_PAIRS]) for scene in scenes]
    limit = sum(len(pairs) for _, pairs in selections) if selections else _MOST_PAIRS
    held_out = np.flatnonzero(drive.held_out[drive.sources] & drive.held_out[drive.targets])
    if len(held_out):
        selections.append((drive, rng.permutation(held_out)[:limit]))
    if selections:
        calibrate_reachability(network, selections)


def calibrate_reachability(network: AnyNetwork, chosen: Sequence[PairSelection]) -> None:
    """Fit the network's calibration on chosen labelled pairs of scenes."""
    network.calibration.copy_(torch.tensor([1.0, 0.0]))
    # The logits are recovered from r, so the calibration must be the identity until it is fitted.
    predictor = NetworkPredictor(network, "in calibration")
    parts = [compare_labelled(predictor, scene, pairs) for scene, pairs in chosen]
    scores, _, positive, _ = (np.concatenate(column) for column in zip(*parts, strict=True))
    network.calibration.copy_(torch.tensor(fit_platt(logit(scores), positive)))


def fit_platt(logits: NDArray[np.float64], positive: NDArray[np.bool_]) -> tuple[float, float]:
    """Return the scale (> 0) and offset that minimise the cross-entropy of logits (N,) against labels (N,)."""
    if positive.all() or not positive.any():
        return 1.0, 0.0  # With only one class, the optimum is at infinity.

    def cross_entropy(numbers: NDArray[np.float64]) -> float:
        scaled = np.exp(numbers[0]) * logits + numbers[1]
        return float((np.logaddexp(0, scaled) - positive * scaled).mean())

    found = minimize(cross_entropy, np.zeros(2), method="Nelder-Mead")
    return float(np.exp(found.x[0])), float(found.x[1])


def logit(probability: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the inverse of the logistic function, clipped to finite values."""
    clipped = np.clip(probability, expit(-30), expit(30))
    return np.log(clipped) - np.log1p(-clipped)
