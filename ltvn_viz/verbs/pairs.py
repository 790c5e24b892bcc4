"""`ltvn pairs`: look through a dataset's labelled pairs in the browser."""

from dataclasses import dataclass
from pathlib import Path

from ltvn_core.verbs.verb import Verb


@dataclass(frozen=True, kw_only=True)
class PairsVerb(Verb):
    """Open a page on the labelled pairs of a dataset: both images, the label and its reason, and the network's
    prediction."""

    job = "ltvn_viz.verbs.jobs.pairs:show_pairs"

    folder: Path = Path("data")
    """Folder of the dataset from `ltvn dataset`."""
    port: int = 8080
    """Port on 127.0.0.1; 0 takes any free one."""
    weights: Path | None = None
    """Weights to use instead of the shipped ones."""
