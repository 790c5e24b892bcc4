"""Generates shards: samples clusters of poses in a scene, renders their images and labels their pairs.

Interrupted work continues with the missing scenes. Scenes come in through the Protocols of
`ltvn_core.training_data.scene_protocols`.
"""

import json
import logging
import zlib
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray
from tqdm import tqdm

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.training_data.pose_sampling import (
    CameraVariation,
    ClusterSampling,
    cluster_pairs,
    cluster_poses,
    hard_negative_pairs,
)
from ltvn_core.training_data.reachability_labels import PairLabels, ReachabilityLimits, label_poses
from ltvn_core.training_data.scene_protocols import DatasetScene, OpenDatasetScene
from ltvn_core.training_data.shards import Shard, read_recipe, shard_path, write_shard
from ltvn_core.types import Pose, Renderer

log = logging.getLogger(__name__)

_PAIRS_AT_ONCE = 4096
"""Limits the memory of labelling."""


@dataclass(frozen=True, slots=True)
class DatasetRecipe:
    """Everything except the scenes that determines a dataset; its JSON text identifies the dataset.

    Field names are part of that text: renaming one makes every existing dataset stale.
    """

    seed: int = 0
    """Seed of the poses; each scene has its own generator."""
    clusters: int = 280
    """Clusters of poses per scene."""
    sampling: ClusterSampling = field(default_factory=ClusterSampling)
    """Distribution of the poses within a cluster."""
    strangers: int = 28
    """Hard negatives per cluster, see `pose_sampling`; the name is older than that term."""
    cameras: CameraVariation = field(default_factory=CameraVariation)
    """Variation of the camera between clusters."""
    limits: ReachabilityLimits = field(default_factory=ReachabilityLimits)
    """Limits of the reachability criteria."""

    def text(self) -> str:
        """Return the recipe as text, equal for equal recipes."""
        return json.dumps(asdict(self), sort_keys=True)

    def make(self, world: DatasetScene) -> Shard:
        """Make the shard of one scene."""
        return make_shard(world, self)


class ShardRecipe(Protocol):
    """Generates the shard of a scene; recipes with equal texts generate equal bytes."""

    def text(self) -> str:
        """Return everything that determines the shards, as JSON."""
        ...

    def make(self, world: DatasetScene) -> Shard:
        """Make the shard of one scene."""
        ...


def generate_shards(
    names: Sequence[str],
    open_world: OpenDatasetScene,
    folder: Path,
    recipe: ShardRecipe,
    *,
    processes: int = 1,
    on_progress: Callable[[int, int], None] | None = None,
) -> list[Path]:
    """Generate the shards of scenes in a folder, except those that are already there, and return their paths.

    Args:
        names: Names of the scenes.
        open_world: Opens a scene by name; must be picklable for several processes.
        folder: Where the shards are written.
        recipe: How they are generated.
        processes: Number of worker processes.
        on_progress: Called with the number of finished shards and of all, at first and after each; an exception in it
            stops the work.
    """
    paths = [shard_path(folder, name) for name in names]
    text = recipe.text()
    missing = [(name, path) for name, path in zip(names, paths, strict=True) if read_recipe(path) != text]
    done = len(paths) - len(missing)
    if on_progress is not None:
        on_progress(done, len(paths))
    made = Parallel(n_jobs=max(1, min(processes, len(missing))), return_as="generator_unordered")(
        # Workers outlive a call and may have been started in another folder.
        delayed(_make_and_write)(name, open_world, path.absolute(), recipe)
        for name, path in missing
    )
    bar = tqdm(made, desc="scenes", unit="scene", initial=done, total=len(paths), disable=not missing)
    for count, line in enumerate(bar, done + 1):
        log.info(line)
        if on_progress is not None:
            on_progress(count, len(paths))
    return paths


def _make_and_write(name: str, open_world: OpenDatasetScene, path: Path, recipe: ShardRecipe) -> str:
    shard = recipe.make(open_world(name))
    write_shard(shard, path)
    reachable = 100 * shard.reachable.sum() / max(len(shard.reachable), 1)
    return f"{name}: {len(shard.rgb)} images, {len(shard.sources)} pairs, {reachable:.0f} % reachable"


def make_shard(world: DatasetScene, recipe: DatasetRecipe) -> Shard:
    """Sample, render and label the pairs of one scene.

    Labels describe poses and not cameras, so they are computed from the depth of the nominal camera.
    """
    rng = np.random.default_rng([recipe.seed, zlib.crc32(world.name.encode())])
    clusters = cluster_poses(world.floor, rng, recipe.clusters, recipe.sampling)
    size = recipe.sampling.size
    poses = clusters.reshape(-1, 3)
    group = np.repeat(np.arange(len(clusters), dtype=np.int32), size)
    rgb, depth_mm = render_poses(world.camera, poses)
    near = cluster_pairs(len(clusters), size)
    negatives = hard_negative_pairs(rng, poses, group, rgb, depth_mm, recipe.strangers * len(clusters))
    sources, targets = (np.concatenate(ends) for ends in zip(near, negatives, strict=True))
    labels = label_image_pairs(world, poses, depth_mm, sources, targets, recipe.limits)
    cameras = recipe.cameras.draw(rng, len(clusters))
    for row in np.flatnonzero([cameras[each] != LOCOBOT.camera for each in group]):
        rgb[row], depth_mm[row] = _render(world.camera, poses[row], cameras[group[row]])
    return Shard(
        name=world.name,
        recipe=recipe.text(),
        rgb=rgb,
        depth_mm=depth_mm,
        poses=poses,
        group=group,
        sources=sources,
        targets=targets,
        reachable=labels.reachable,
        failed=labels.failed,
        overlap=labels.overlap,
        path_ratio=labels.path_ratio,
    )


def render_poses(
    renderer: Renderer, poses: Pose, camera: CameraModel | None = None
) -> tuple[NDArray[np.uint8], NDArray[np.uint16]]:
    """Return rgb (N, H, W, 3) and depth in millimetres (N, H, W) rendered at poses (N, 3)."""
    size = camera or LOCOBOT.camera
    rgb = np.empty((len(poses), size.height, size.width, 3), np.uint8)
    depth_mm = np.empty((len(poses), size.height, size.width), np.uint16)
    for row, pose in enumerate(poses):
        rgb[row], depth_mm[row] = _render(renderer, pose, size)
    return rgb, depth_mm


def _render(renderer: Renderer, pose: Pose, camera: CameraModel) -> tuple[NDArray[np.uint8], NDArray[np.uint16]]:
    rgb, depth = renderer.render(pose, camera)
    return rgb, np.rint(depth * 1000).astype(np.uint16)


def label_image_pairs(
    world: DatasetScene,
    poses: Pose,
    depth_mm: NDArray[np.uint16],
    sources: NDArray[np.integer],
    targets: NDArray[np.integer],
    limits: ReachabilityLimits,
) -> PairLabels:
    """Return the labels of pairs of images, computed in batches of bounded memory."""
    parts = []
    for first in range(0, len(sources), _PAIRS_AT_ONCE):
        i = sources[first : first + _PAIRS_AT_ONCE]
        j = targets[first : first + _PAIRS_AT_ONCE]
        seen_i = depth_mm[i] / np.float32(1000)
        seen_j = depth_mm[j] / np.float32(1000)
        parts.append(label_poses(poses[i], poses[j], seen_i, seen_j, world.floor, limits=limits))
    return PairLabels._make(np.concatenate(columns) for columns in zip(*parts, strict=True))
