"""`ltvn dataset`: renders labelled image pairs of scenes and stores them."""

from dataclasses import dataclass
from pathlib import Path

from ltvn_core.evaluation.workers import Part
from ltvn_core.network.training_data.shards import DatasetRecipe, generate_shards, read_shard
from ltvn_core.simulation.scene_registry import scene_names
from ltvn_core.training.simulated_scenes import open_dataset_scene
from ltvn_core.verbs.dataset import DatasetVerb
from ltvn_core.verbs.verb import Summary

DEFAULT_SCENE_PREFIXES = ("train-", "tune-0", "tune-1", "tune-2")
"""Name prefixes of the scenes of a dataset by default: scenes for training, and scenes for choosing the best
weights."""


@dataclass(frozen=True)
class DatasetSummary:
    """The size of a dataset."""

    folder: Path
    scenes: int
    images: int
    pairs: int
    reachable: float
    """Share of the pairs that are reachable."""


def make_dataset(options: DatasetVerb) -> Summary:
    """Make the missing shards; raises SceneError and DatasetError."""
    names = options.scenes or tuple(name for name in scene_names() if name.startswith(DEFAULT_SCENE_PREFIXES))
    names = Part.parse(options.part).of(names)
    recipe = DatasetRecipe(seed=options.seed, clusters=options.clusters)
    paths = generate_shards(names, open_dataset_scene, options.folder, recipe, processes=options.processes)
    images = pairs = reachable = 0
    for path in paths:
        shard = read_shard(path)
        images, pairs = images + len(shard.rgb), pairs + len(shard.sources)
        reachable += int(shard.reachable.sum())
    return DatasetSummary(options.folder, len(paths), images, pairs, reachable / max(pairs, 1))
