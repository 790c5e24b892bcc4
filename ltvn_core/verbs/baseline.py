"""`ltvn baseline`: our network learns the labels of a rival on random walks, for a comparison under equal terms.

From the shipped weights it is as good a rival as we can make; from nothing it is the rival of the paper. Some rivals
add layers of their own to the shipped weights, and only those learn and are written.
"""

from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from ltvn_core.verbs.option_types import SystemName
from ltvn_core.verbs.verb import Verb


@dataclass(frozen=True, kw_only=True)
class BaselineVerb(Verb):
    """Train a rival's network: the shipped weights, or new ones, learn its labels of time on random walks."""

    job = "ltvn_core.verbs.jobs.baseline:train_baseline"

    baseline: Positional[SystemName]
    """SPTM: close in time or not. ViNG: how long it takes to get there. SoRB: the same, by three judges. HTM: which of
    many images comes soon after."""
    output: Path
    """The weights to write, with a card beside them; must not exist yet."""
    data: Path = Path("data/walks")
    """Folder of the walks, one file per scene; missing ones are made, the same for both rivals."""
    work: Path | None = None
    """Folder for checkpoints and curves; by default a folder below the walks."""
    minutes: float = 8.0
    """Time for training in one process, in minutes."""
    steps: int | None = None
    """Train for this number of steps of about 200 pairs instead, which gives the same weights on a slower machine."""
    fresh: bool = False
    """Learn from nothing, as in the paper, instead of from the shipped weights; 1,500 steps are a good start."""
    processes: int = 2
    """Scenes that are rendered at the same time."""
    seed: int = 0
    """Draws walks, pairs, batches and augmentation."""
