"""The validation and test scenes of networks, and the metrics on them.

Owns the choice of scenes and the amount of data from each. `ltvn_core.network.metrics` defines the metrics.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING

from ltvn_core.training.simulated_scenes import open_dataset_scene

if TYPE_CHECKING:
    from ltvn_core.network.model_card import HeldOutMetrics, TrainingDataSummary
    from ltvn_core.network.pair_evaluation import LabelledDrive
    from ltvn_core.network.training_data.shards import Shard

VALIDATION_SCENES = ("tune-0", "tune-1", "tune-2")
"""Validation scenes, on which the best weights are selected."""

TEST_SCENES = ("tune-3", "tune-4", "tune-5", "tune-6", "tune-7", "tune-8")
"""Test scenes, on which the metrics of the model card are measured."""


CLUSTERS_PER_SCENE = 180
"""Number of clusters of labelled pairs in each held-out scene."""

IMAGES_PER_DRIVE = 300
"""Number of images of the drive through each held-out scene; six drives have half a million ordered pairs."""

SUBSAMPLING_STEP = 2
"""Step between the used images of a drive, for networks that process each pair from pixels, which is slow."""


@dataclass(frozen=True)
class NetworkMetrics:
    """Metrics of weights in held-out scenes."""

    architecture: str
    fingerprint: str
    scenes: tuple[str, ...]
    far_fpr_at_tpr60: float
    """False positive rate of far pairs at the threshold that accepts 60 % of the near pairs."""
    far_pairs: int
    """Number of far pairs."""
    auc: float
    """Area under the ROC curve on labelled pairs."""
    position_median_m: float
    position_median_1_to_1_5_m: float
    """Median position error of reachable pairs 1 to 1.5 m apart."""
    position_p90_m: float
    yaw_median_deg: float
    ece: float
    pairs: int
    """Number of labelled pairs."""


def drives(names: Sequence[str], *, images: int, every: int = 1) -> "list[LabelledDrive]":
    """Render every n-th of the images of a drive through each of the named scenes. Raises SceneError."""
    import numpy as np

    from ltvn_core.network.pair_evaluation import LabelledDrive
    from ltvn_core.network.training_data.pose_sampling import classify_near_far, sample_drive_poses
    from ltvn_core.network.training_data.reachability_labels import ReachabilityLimits
    from ltvn_core.network.training_data.shards import label_image_pairs, render_poses

    found = []
    for name in names:
        world = open_dataset_scene(name)
        poses = sample_drive_poses(world.floor, np.random.default_rng(0), images)[::every]
        rgb, depth_mm = render_poses(world.camera, poses)
        first, second = np.divmod(np.arange(len(poses) ** 2), len(poses))
        labels = label_image_pairs(world, poses, depth_mm, first, second, ReachabilityLimits())
        near, far = classify_near_far(poses, world.floor)
        found.append(LabelledDrive(world.name, rgb, depth_mm, near, far, poses, labels.reachable.reshape(near.shape)))
    return found


def measure_network(
    weights: Path,
    folder: Path,
    scenes: Sequence[str],
    *,
    clusters: int = CLUSTERS_PER_SCENE,
    images: int = IMAGES_PER_DRIVE,
) -> "HeldOutMetrics":
    """Evaluate weights on scenes; their labelled pairs are cached in a folder. Raises SceneError and WeightsError."""
    import numpy as np

    from ltvn_core.network.architecture import StackedArchitecture
    from ltvn_core.network.model_card import HeldOutMetrics
    from ltvn_core.network.pair_evaluation import evaluate_all_pairs, evaluate_pairs
    from ltvn_core.network.predictor import load_predictor
    from ltvn_core.network.training_data.shards import DatasetRecipe, generate_shards, read_shard

    predictor = load_predictor(weights)
    rng = np.random.default_rng(0)
    paths = generate_shards(scenes, open_dataset_scene, folder, DatasetRecipe(clusters=clusters), processes=2)
    is_slow = isinstance(predictor.architecture, StackedArchitecture)
    seen = drives(scenes, images=images, every=SUBSAMPLING_STEP if is_slow else 1)
    pairs = evaluate_pairs(predictor, [read_shard(path) for path in paths], rng)
    drive_pairs, wormholes = evaluate_all_pairs(predictor, seen)
    return HeldOutMetrics(tuple(drive.name for drive in seen), pairs, drive_pairs, wormholes)


def figures(weights: Path, measured: "HeldOutMetrics") -> NetworkMetrics:
    """Return the most important metrics of `measured`. Raises WeightsError."""
    from ltvn_core.network.weights_file import load_weights, weights_fingerprint

    found = asdict(measured.pairs) | asdict(measured.drives)
    named = {field.name: found[field.name] for field in fields(NetworkMetrics) if field.name in found}
    return NetworkMetrics(
        architecture=load_weights(weights).size.name,
        fingerprint=weights_fingerprint(weights),
        scenes=measured.scenes,
        **named,
    )


def training_data_summary(learned: Sequence["Shard"]) -> "TrainingDataSummary":
    """Return the summary of the training shards and validation scenes for a model card."""
    from ltvn_core.network.model_card import TrainingDataSummary

    return TrainingDataSummary(
        scenes=tuple(shard.name for shard in learned),
        validation_scenes=VALIDATION_SCENES,
        images=sum(len(shard.rgb) for shard in learned),
        pairs=sum(len(shard.sources) for shard in learned),
        recipe=learned[0].recipe,
    )
