"""Simulated scenes for data generation, and random walks through them with the labels of SPTM or ViNG.

Owns opening a scene by name, and the folder and the seed of the walks.
"""

import zlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ltvn_core.network.training_data.pose_sampling import DatasetScene
    from ltvn_core.network.training_data.shards import Shard
    from ltvn_core.network.training_data.temporal_rules import TemporalLabelRule


def open_dataset_scene(name: str) -> "DatasetScene":
    """Open a simulated scene for data generation. Raises SceneError."""
    from ltvn_core.network.training_data.pose_sampling import DatasetScene
    from ltvn_core.simulation.rendering.renderer_opening import open_renderer
    from ltvn_core.simulation.scene_registry import load_scene

    scene = load_scene(name)
    return DatasetScene(scene.name, scene.clearance, open_renderer(scene))


def make_walks(
    names: Sequence[str],
    folder: Path,
    *,
    seed: int = 0,
    processes: int = 1,
    on_progress: Callable[[int, int], None] | None = None,
) -> list[Path]:
    """Return the files of random walks through scenes, and make the missing ones.

    Raises DatasetError and SceneError.
    """
    from ltvn_core.network.training_data.random_walk import WalkRecipe
    from ltvn_core.network.training_data.shards import generate_shards

    recipe = WalkRecipe(seed=seed)
    return generate_shards(names, open_dataset_scene, folder, recipe, processes=processes, on_progress=on_progress)


def labelled_walks(
    rule: "TemporalLabelRule", names: Sequence[str], folder: Path, *, seed: int = 0, processes: int = 1
) -> "list[Shard]":
    """Return random walks through scenes, labelled by a rule. Raises the errors of `make_walks`."""
    import numpy as np

    from ltvn_core.network.training_data.random_walk import label_walks
    from ltvn_core.network.training_data.shards import read_shard

    walks = [read_shard(path) for path in make_walks(names, folder, seed=seed, processes=processes)]
    draws = [np.random.default_rng([seed, zlib.crc32(walk.name.encode()), 1]) for walk in walks]
    return [label_walks(walk, rule, rng) for walk, rng in zip(walks, draws, strict=True)]
