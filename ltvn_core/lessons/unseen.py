"""The scenes by which networks are chosen and judged, and the figures that come of it.

Owns which scenes these are and how much is looked at there. The figures are defined in `ltvn_core.model.figures`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ltvn_core.lessons.worlds import open_world

if TYPE_CHECKING:
    from ltvn_core.model.assessment import Drive
    from ltvn_core.model.card import Measured

VALIDATION = ("tune-0", "tune-1", "tune-2")
"""Scenes by which the best weights are chosen."""

UNSEEN = ("tune-3", "tune-4", "tune-5", "tune-6", "tune-7", "tune-8")
"""Scenes on which the figures of the card are measured."""


CLUSTERS = 180
"""Clusters of labelled pairs in each unseen scene."""

IMAGES = 300
"""Images of the drive through each unseen scene: half a million ordered pairs in six."""

THINNED = 2
"""A network that looks at every pair from the pixels on sees every so manieth image of the drives, to save its time."""


@dataclass(frozen=True)
class NetworkFigures:
    """How good weights are in scenes that they have not seen."""

    architecture: str
    fingerprint: str
    scenes: tuple[str, ...]
    far_fpr_at_tpr60: float
    """Share of the far pairs of drives that pass where 60 % of the near ones do, each pair by itself,"""
    far_pairs: int
    """of so many."""
    auc: float
    """On labelled pairs, as are the following."""
    position_median_m: float
    position_median_1_to_1_5_m: float
    """Of pairs that are 1 to 1.5 m apart."""
    position_p90_m: float
    yaw_median_deg: float
    ece: float
    pairs: int
    """Labelled pairs."""


def drives(names: Sequence[str], *, images: int) -> "list[Drive]":
    """Look along a drive through each of the named scenes. Raises SceneError."""
    import numpy as np

    from ltvn_core.data.drives import classify_pairs, drive_poses
    from ltvn_core.data.generate import label_all, render_all
    from ltvn_core.data.labels import Limits
    from ltvn_core.model.assessment import Drive

    found = []
    for name in names:
        world = open_world(name)
        poses = drive_poses(world.floor, np.random.default_rng(0), images)
        rgb, depth_mm = render_all(world.camera, poses)
        first, second = np.divmod(np.arange(images**2), images)
        labels = label_all(world, poses, depth_mm, first, second, Limits())
        near, far = classify_pairs(poses, world.floor)
        found.append(Drive(world.name, rgb, depth_mm, near, far, poses, labels.reachable.reshape(images, images)))
    return found


def measure(
    weights: Path, folder: Path, scenes: Sequence[str], *, clusters: int = CLUSTERS, images: int = IMAGES
) -> "Measured":
    """Measure weights on scenes, whose labelled pairs are kept in a folder. Raises SceneError and WeightsError."""
    import numpy as np

    from ltvn_core.data.generate import DatasetRecipe, generate
    from ltvn_core.data.shards import read_shard
    from ltvn_core.model.architecture import StackedArchitecture
    from ltvn_core.model.assessment import assess_all_pairs, assess_pairs, thin_out
    from ltvn_core.model.card import Measured
    from ltvn_core.model.predictor import load_predictor

    predictor, rng = load_predictor(weights), np.random.default_rng(0)
    paths = generate(scenes, open_world, folder, DatasetRecipe(clusters=clusters), processes=2)
    seen = drives(scenes, images=images)
    if isinstance(predictor.architecture, StackedArchitecture):
        seen = [thin_out(drive, every=THINNED) for drive in seen]
    pairs = assess_pairs(predictor, [read_shard(path) for path in paths], rng)
    drive_pairs, wormholes = assess_all_pairs(predictor, seen)
    return Measured(tuple(drive.name for drive in seen), pairs, drive_pairs, wormholes)


def figures(weights: Path, measured: "Measured") -> NetworkFigures:
    """Return the figures that matter most. Raises WeightsError."""
    from ltvn_core.model.weights import load_weights, weights_fingerprint

    pairs, drives_ = measured.pairs, measured.drives
    return NetworkFigures(
        load_weights(weights).size.name,
        weights_fingerprint(weights),
        measured.scenes,
        drives_.far_fpr_at_tpr60,
        drives_.far_pairs,
        pairs.auc,
        pairs.position_median_m,
        pairs.position_median_1_to_1_5_m,
        pairs.position_p90_m,
        pairs.yaw_median_deg,
        pairs.ece,
        pairs.pairs,
    )
