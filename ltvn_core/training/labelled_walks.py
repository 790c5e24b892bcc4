"""Random walks through simulated scenes, labelled as SPTM or ViNG do. Owns where they lie and which dice label them."""

import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ltvn_core.training.simulated_scenes import open_dataset_scene

if TYPE_CHECKING:
    from ltvn_core.training_data.shards import Shard


def labelled_walks(
    baseline: str, names: Sequence[str], folder: Path, *, seed: int = 0, processes: int = 1
) -> "list[Shard]":
    """Return random walks through scenes, labelled by a rival's rule; walks that do not lie in the folder are made.

    Raises DatasetError and SceneError.
    """
    import numpy as np

    from ltvn_core.training_data.random_walk import WalkRecipe
    from ltvn_core.training_data.shard_generation import generate_shards
    from ltvn_core.training_data.shards import read_shard
    from ltvn_core.training_data.temporal_pairs import label_walks
    from ltvn_core.training_data.temporal_rules import TEMPORAL_RULES

    paths = generate_shards(names, open_dataset_scene, folder, WalkRecipe(seed=seed), processes=processes)
    walks = [read_shard(path) for path in paths]
    draws = [np.random.default_rng([seed, zlib.crc32(walk.name.encode()), 1]) for walk in walks]
    return [label_walks(walk, TEMPORAL_RULES[baseline], rng) for walk, rng in zip(walks, draws, strict=True)]
