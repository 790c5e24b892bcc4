"""Evaluates a network on the robot's own drive with labels from odometry, without ground truth.

`ltvn_core.network.metrics.reachability_metrics` defines the metrics.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ltvn_core.geometry import relative
from ltvn_core.network.metrics.pair_evaluation import encode_images, predict_pairs
from ltvn_core.network.metrics.reachability_metrics import DriveMetrics, PairMetrics, drive_metrics, pair_metrics
from ltvn_core.network.optimization.mixed_batches import LabelledTrajectory
from ltvn_core.types import Predictor


@dataclass(frozen=True, slots=True)
class TrajectoryMetrics:
    """Metrics on a robot's own drive, with labels from odometry."""

    pairs: PairMetrics
    """On labelled pairs at most H images apart."""
    far: DriveMetrics
    """The reachable ones of them against pairs that are far apart whatever the drift of odometry."""


def evaluate_trajectory(
    predictor: Predictor, drive: LabelledTrajectory, rng: np.random.Generator, *, near: int, far: int
) -> TrajectoryMetrics:
    """Evaluate a predictor on random near and far pairs of a drive, up to the given numbers."""
    features = encode_images(predictor, drive.rgb, drive.depth_mm)
    chosen = rng.permutation(len(drive.sources))[:near]
    i = drive.sources[chosen].astype(np.intp)
    j = drive.targets[chosen].astype(np.intp)
    found = predict_pairs(predictor, features, i, j)
    reachable = drive.reachable[chosen]
    true = relative(drive.poses[i], drive.poses[j])
    apart = predict_pairs(predictor, features, *far_pairs(drive, rng, far)).reachability
    return TrajectoryMetrics(pair_metrics(*found, reachable, true), drive_metrics(found.reachability[reachable], apart))


def far_pairs(
    drive: LabelledTrajectory, rng: np.random.Generator, count: int, among: NDArray[np.intp] | None = None
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Draw up to `count` ordered pairs of rows that are certainly far apart, spread over the whole drive."""
    among = np.arange(len(drive.poses)) if among is None else among
    sources, targets = [np.empty(0, np.intp)], [np.empty(0, np.intp)]
    rows = rng.permutation(among)
    each = max(count // max(len(rows), 1), 1)
    for row in rows[:count]:
        away = among[drive.far(np.array([row]), among)[0]]
        drawn = rng.permutation(away)[:each]
        sources.append(np.full(len(drawn), row))
        targets.append(drawn)
    return np.concatenate(sources), np.concatenate(targets)
