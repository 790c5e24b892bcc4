"""`ltvn dataset`: renders labelled image pairs of scenes and stores them."""

from dataclasses import dataclass
from pathlib import Path

from ltvn_core.verbs.outputs import FilledFolder
from ltvn_core.verbs.verb import Verb


@dataclass(frozen=True, kw_only=True)
class DatasetVerb(Verb):
    """Render image pairs of scenes, and label them as reachable or not; continues after an interruption."""

    job = "ltvn_core.verbs.jobs.dataset:make_dataset"

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
