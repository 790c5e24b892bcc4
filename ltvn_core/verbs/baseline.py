"""`ltvn baseline`: trains our network on the labels of a rival, on random walks, for a fair comparison.

Started from the shipped weights, it is the strongest rival that we can train; started from random weights, it is the
rival of the paper. Some rivals add layers to the shipped weights; then only these layers are trained and saved.
"""

from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from ltvn_core.verbs.option_types import SystemName
from ltvn_core.verbs.outputs import FilledFolder, NewWeights
from ltvn_core.verbs.verb import Verb


@dataclass(frozen=True, kw_only=True)
class BaselineVerb(Verb):
    """Train the network of a rival on its temporal labels, from the shipped weights or from new ones, on random
    walks."""

    job = "ltvn_core.verbs.jobs.baseline:train_baseline"

    baseline: Positional[SystemName]
    """The rival. SPTM: whether two images are close in time. ViNG: the time from one image to the other. SoRB: the
    same, by an ensemble of three. HTM: which of many images comes soon after."""
    output: NewWeights
    """The weights to write, with a card beside them; must not exist yet."""
    data: FilledFolder = Path("data/walks")
    """Folder of the walks, one file per scene; missing files are made, and all rivals use the same ones."""
    work: FilledFolder | None = None
    """Folder for checkpoints and curves; by default a folder below the walks."""
    minutes: float = 8.0
    """Time for training in one process, in minutes."""
    steps: int | None = None
    """Train for this number of steps of about 200 pairs instead; then a slower machine gives the same weights."""
    fresh: bool = False
    """Start from random weights, as in the paper, instead of from the shipped weights; 1,500 steps are a good start."""
    processes: int = 2
    """Number of scenes that are rendered at the same time."""
    seed: int = 0
    """Seed of walks, pairs, batches and augmentation."""
