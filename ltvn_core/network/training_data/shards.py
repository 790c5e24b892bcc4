"""The labelled image pairs of one scene (a shard): in memory, as a safetensors file, and how they are generated.

Equal content gives equal bytes. Generation samples clusters of poses in a scene, renders their images and labels their
pairs; interrupted work continues with the missing scenes.
"""

import json
import logging
import zlib
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file
from tqdm import tqdm

from ltvn_core.atomic_files import atomic_replacement
from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.errors import DatasetError
from ltvn_core.network.training_data.pose_sampling import (
    CameraVariation,
    ClusterSampling,
    DatasetScene,
    OpenDatasetScene,
    cluster_pairs,
    cluster_poses,
    hard_negative_pairs,
)
from ltvn_core.network.training_data.reachability_labels import PairLabels, ReachabilityLimits, label_poses
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.structured_text import parse_json
from ltvn_core.types import Pose, Renderer

log = logging.getLogger(__name__)

SCHEMA = "ltvn-pairs-1"
"""Name of the file format; files of another format are refused."""

SHARD_SUFFIX = ".pairs.safetensors"
"""Suffix of the names of shards."""


@dataclass(frozen=True, eq=False)
class Shard:
    """The images of one scene and labelled pairs of them."""

    name: str
    """Name of the scene."""
    recipe: str
    """JSON text of the recipe that generated the shard; a shard with another recipe is generated again."""
    rgb: NDArray[np.uint8]
    """(N, H, W, 3) colours."""
    depth_mm: NDArray[np.uint16]
    """(N, H, W) depth in millimetres; 0 where missing."""
    poses: Pose
    """(N, 3) poses in the scene's frame."""
    group: NDArray[np.int32]
    """(N,) cluster of each image."""
    sources: NDArray[np.int32]
    """(P,) rows of the source images."""
    targets: NDArray[np.int32]
    """(P,) rows of the target images."""
    reachable: NDArray[np.bool_]
    """(P,) whether each pair is reachable."""
    failed: NDArray[np.uint8]
    """(P,) flags of `ltvn_core.network.training_data.reachability_labels.FailedCriteria`."""
    overlap: NDArray[np.float32]
    """(P,) share of the target's points that the source sees; nan where not measured."""
    path_ratio: NDArray[np.float32]
    """(P,) ratio of the path to the straight line; nan where not measured."""


_ARRAYS = tuple(field.name for field in fields(Shard) if field.name not in ("name", "recipe"))


def shard_path(folder: Path, name: str) -> Path:
    """Return the path of the shard of a scene."""
    return folder / f"{Path(name).stem}{SHARD_SUFFIX}"


def shard_scene(path: Path) -> str:
    """Return the name of a shard's scene, from the name of its file."""
    return path.name.removesuffix(SHARD_SUFFIX)


def dataset_shards(folder: Path) -> list[Path]:
    """Return the files of a folder with the suffix of shards, in order."""
    return sorted(folder.glob(f"*{SHARD_SUFFIX}"))


def split_shards(shards: Iterable[Shard], validation_scenes: Collection[str]) -> tuple[list[Shard], list[Shard]]:
    """Split shards into training and validation scenes, each in their order."""
    every = list(shards)
    learned = [shard for shard in every if shard.name not in validation_scenes]
    return learned, [shard for shard in every if shard.name in validation_scenes]


def write_shard(shard: Shard, path: Path) -> None:
    """Write a shard atomically.

    Raises:
        DatasetError: The file cannot be written.
    """
    # One entry only: safetensors writes several in random order, and the bytes must not vary.
    metadata = {"ltvn": json.dumps({"schema": SCHEMA, "name": shard.name, "recipe": shard.recipe})}
    arrays = {name: np.ascontiguousarray(getattr(shard, name)) for name in _ARRAYS}
    try:
        with atomic_replacement(path) as part:
            save_file(arrays, part, metadata)
    except (OSError, SafetensorError) as error:
        raise DatasetError(
            f"{path}: the shard could not be written ({error}); free some space and run again."
        ) from error


def read_shard(path: Path) -> Shard:
    """Read a shard.

    Raises:
        DatasetError: The file is missing, truncated, inconsistent or of another format.
    """
    try:
        with safe_open(path, framework="numpy") as file:
            metadata = _metadata(file)
            if (found := metadata.get("schema", "something else")) != SCHEMA:
                raise DatasetError(f"{path}: holds {found!r}, not {SCHEMA!r}; make the dataset again.")
            arrays = {name: file.get_tensor(name) for name in _ARRAYS}
    except (OSError, SafetensorError) as error:
        raise DatasetError(f"{path}: not a complete shard ({error}); delete it and make the dataset again.") from error
    shard = Shard(name=metadata["name"], recipe=metadata["recipe"], **arrays)
    _check_arrays(shard, path)
    return shard


def read_recipe(path: Path) -> str | None:
    """Return the recipe of a shard, or None if there is no complete shard."""
    try:
        with safe_open(path, framework="numpy") as file:
            metadata = _metadata(file)
    except (OSError, SafetensorError):
        return None
    return metadata.get("recipe") if metadata.get("schema") == SCHEMA else None


def _check_arrays(shard: Shard, path: Path) -> None:
    """Raise DatasetError for arrays that do not belong together, as another program might write them."""
    count = len(shard.poses)
    pairs = len(shard.sources)
    size = (LOCOBOT.camera.height, LOCOBOT.camera.width)
    if shard.rgb.shape != (count, *size, 3) or shard.depth_mm.shape != (count, *size):
        raise DatasetError(
            f"{path}: {count} poses with images {shard.rgb.shape} and depths {shard.depth_mm.shape}; each pose has one "
            f"image of {size} (rows, columns). Make the dataset again."
        )
    columns = (shard.targets, shard.reachable, shard.failed, shard.overlap, shard.path_ratio)
    if shard.group.shape != (count,) or any(len(column) != pairs for column in columns):
        raise DatasetError(f"{path}: its columns are of different lengths; make the dataset again.")
    if (
        pairs
        and not 0
        <= min(shard.sources.min(), shard.targets.min())
        <= max(shard.sources.max(), shard.targets.max())
        < count
    ):
        raise DatasetError(f"{path}: a pair refers to a missing image; make the dataset again.")


def _metadata(file: Any) -> dict[str, str]:
    """Return the metadata of an open safetensors file, empty if another program wrote it."""
    try:
        return parse_json((file.metadata() or {})["ltvn"])
    except (KeyError, ValueError):
        return {}


_PAIRS_AT_ONCE = 4096
"""Number of pairs labelled at once, which limits memory."""


@dataclass(frozen=True, slots=True)
class DatasetRecipe:
    """Everything except the scenes that determines a dataset; its JSON text identifies the dataset.

    Field names are part of that text: renaming one makes every existing dataset stale.
    """

    seed: int = 0
    """Seed of the poses; each scene has its own generator."""
    clusters: int = 280
    """Number of clusters of poses per scene."""
    sampling: ClusterSampling = field(default_factory=ClusterSampling)
    """Distribution of the poses within a cluster."""
    strangers: int = 28
    """Number of hard negatives per cluster, see `pose_sampling`; the name is older than that term."""
    cameras: CameraVariation = field(default_factory=CameraVariation)
    """Variation of the camera between clusters."""
    limits: ReachabilityLimits = field(default_factory=ReachabilityLimits)
    """Limits of the reachability criteria."""

    def text(self) -> str:
        """Return the recipe as text, equal for equal recipes."""
        return json.dumps(asdict(self), sort_keys=True)

    def make(self, world: DatasetScene) -> Shard:
        """Sample, render and label the pairs of one scene.

        Labels describe poses and not cameras, so they are computed from the depth of the nominal camera.
        """
        rng = np.random.default_rng([self.seed, zlib.crc32(world.name.encode())])
        clusters = cluster_poses(world.floor, rng, self.clusters, self.sampling)
        poses = clusters.reshape(-1, 3)
        group = np.repeat(np.arange(len(clusters), dtype=np.int32), self.sampling.size)
        rgb, depth_mm = render_poses(world.camera, poses)
        near = cluster_pairs(len(clusters), self.sampling.size)
        negatives = hard_negative_pairs(rng, poses, group, rgb, depth_mm, self.strangers * len(clusters))
        sources, targets = (np.concatenate(ends) for ends in zip(near, negatives, strict=True))
        labels = label_image_pairs(world, poses, depth_mm, sources, targets, self.limits)
        cameras = self.cameras.draw(rng, len(clusters))
        for row in np.flatnonzero([cameras[each] != LOCOBOT.camera for each in group]):
            rgb[row], depth_mm[row] = _render(world.camera, poses[row], cameras[group[row]])
        return Shard(
            name=world.name,
            recipe=self.text(),
            rgb=rgb,
            depth_mm=depth_mm,
            poses=poses,
            group=group,
            sources=sources,
            targets=targets,
            **labels._asdict(),
        )


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
        folder: Folder for the shards.
        recipe: Recipe that generates the shards.
        processes: Number of worker processes.
        on_progress: Called with the number of finished shards and of all shards, at the start and after each shard; an
            exception in it stops the work.
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
