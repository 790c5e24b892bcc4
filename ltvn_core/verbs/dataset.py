"""`ltvn dataset`: renders labelled image pairs of scenes and stores them."""

from dataclasses import dataclass
from pathlib import Path

from ltvn_core.verbs.outputs import FilledFolder
from ltvn_core.verbs.verb import Summary, Verb

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


@dataclass(frozen=True, kw_only=True)
class DatasetVerb(Verb):
    """Render image pairs of scenes, and label them as reachable or not; continues after an interruption."""

    folder: FilledFolder = Path("data")
    """Folder of the shards, one file per scene."""
    scenes: tuple[str, ...] = ()
    """Scenes by name or by the path of a mesh; by default those of training and validation."""
    clusters: int = 280
    """Clusters of eight images per scene; each gives 56 pairs within and about 28 with others."""
    processes: int = 2
    """Number of scenes that are rendered at the same time."""
    seed: int = 0
    """Seed of the poses."""
    part: str = ""
    """Only a share of the scenes, for arrays of jobs; 3/16 is the third of sixteen."""

    def run(self) -> Summary:
        """Make the missing shards; raises SceneError and DatasetError."""
        from ltvn_core.evaluation.workers import Part
        from ltvn_core.network.training_data.shards import DatasetRecipe, generate_shards, read_shard
        from ltvn_core.simulation.scene_registry import scene_names
        from ltvn_core.training.simulated_scenes import open_dataset_scene

        names = self.scenes or tuple(name for name in scene_names() if name.startswith(DEFAULT_SCENE_PREFIXES))
        names = Part.parse(self.part).of(names)
        recipe = DatasetRecipe(seed=self.seed, clusters=self.clusters)
        paths = generate_shards(names, open_dataset_scene, self.folder, recipe, processes=self.processes)
        images = pairs = reachable = 0
        for path in paths:
            shard = read_shard(path)
            images, pairs = images + len(shard.rgb), pairs + len(shard.sources)
            reachable += int(shard.reachable.sum())
        return DatasetSummary(self.folder, len(paths), images, pairs, reachable / max(pairs, 1))
