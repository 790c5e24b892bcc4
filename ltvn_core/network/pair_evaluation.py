"""Evaluates a network on labelled pairs and on drives, for validation during training and for reports.

`ltvn_core.network.metrics` defines the metrics.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ltvn_core.geometry import relative
from ltvn_core.network.metrics import DriveMetrics, PairMetrics, drive_metrics, pair_metrics
from ltvn_core.network.predictor import NetworkPredictor
from ltvn_core.network.training_examples import SceneExamples
from ltvn_core.types import Pose, Waypoint


@dataclass(frozen=True, eq=False)
class LabelledDrive:
    """The images of a mapping drive, with its near, far and reachable ordered pairs."""

    name: str
    rgb: NDArray[np.uint8]
    """(N, H, W, 3) colours."""
    depth_mm: NDArray[np.uint16]
    """(N, H, W) depth in millimetres; 0 where missing."""
    near: NDArray[np.bool_]
    """(N, N) near pairs, see `ltvn_core.network.training_data.pose_sampling.classify_near_far`."""
    far: NDArray[np.bool_]
    """(N, N) far pairs."""
    poses: Pose
    """(N, 3) poses of the images."""
    reachable: NDArray[np.bool_]
    """(N, N): labels of all ordered pairs by the criteria of the dataset."""


def evaluate_pairs(
    predictor: NetworkPredictor, scenes: Sequence[SceneExamples], rng: np.random.Generator, *, limit: int | None = None
) -> PairMetrics:
    """Evaluate a predictor on labelled pairs; with `limit`, on a random sample of that size from each scene."""
    parts = []
    for scene in scenes:
        pairs = np.arange(len(scene.sources))
        if limit is not None and limit < len(pairs):
            pairs = np.sort(rng.choice(pairs, limit, replace=False))
        parts.append(compare_labelled(predictor, scene, pairs))
    return pair_metrics(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def compare_labelled(
    predictor: NetworkPredictor, scene: SceneExamples, pairs: NDArray[np.intp]
) -> tuple[NDArray[np.float64], Waypoint, NDArray[np.bool_], Waypoint]:
    """Return reachability and waypoint as predicted, and then as labelled, of some labelled pairs of a scene."""
    i, j = scene.sources[pairs], scene.targets[pairs]
    used, rows = np.unique(np.concatenate([i, j]), return_inverse=True)
    features = predictor.encode_images(scene.rgb[used], scene.depth_mm[used])
    found = predictor.predict_rows(features, rows[: len(i)], rows[len(i) :])
    true = relative(scene.poses[i], scene.poses[j])
    return found.reachability, found.waypoints, scene.reachable[pairs], true


def evaluate_drives(
    predictor: NetworkPredictor, drives: Sequence[LabelledDrive], rng: np.random.Generator, *, limit: int | None = None
) -> DriveMetrics:
    """Evaluate a predictor on the near and far ordered pairs of drives.

    With `limit`, at most that many near and far pairs of each drive are compared, drawn at random.
    """
    near = []
    far = []
    for drive in drives:
        features = predictor.encode_images(drive.rgb, drive.depth_mm)
        for mask, scores in ((drive.near, near), (drive.far, far)):
            pairs = np.argwhere(mask)
            if limit is not None and len(pairs) > limit:
                pairs = pairs[np.sort(rng.choice(len(pairs), limit, replace=False))]
            scores.append(predictor.predict_rows(features, *pairs.T).reachability)
    return drive_metrics(np.concatenate(near), np.concatenate(far))


def evaluate_all_pairs(
    predictor: NetworkPredictor, drives: Sequence[LabelledDrive]
) -> tuple[PairMetrics, DriveMetrics]:
    """Evaluate a predictor on all ordered image pairs of drives, and on the near and far ones among them."""
    parts = []
    for drive in drives:
        features = predictor.encode_images(drive.rgb, drive.depth_mm)
        i, j = np.nonzero(~np.eye(len(features), dtype=bool))
        labels = drive.reachable[i, j], relative(drive.poses[i], drive.poses[j]), drive.near[i, j], drive.far[i, j]
        parts.append((*predictor.predict_rows(features, i, j), *labels))
    *compared, near, far = (np.concatenate(column) for column in zip(*parts, strict=True))
    return pair_metrics(*compared), drive_metrics(compared[0][near], compared[0][far])
