"""`ltvn pairs`: look through a dataset's labelled pairs in the browser."""

import logging
from dataclasses import dataclass
from pathlib import Path

from ltvn_core.verbs.verb import Summary, Verb

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class PairsSummary:
    """The page is closed again."""

    folder: Path


@dataclass(frozen=True, kw_only=True)
class PairsVerb(Verb):
    """Open a page on the labelled pairs of a dataset: both images, the label and why, and what the network says."""

    folder: Path = Path("data")
    """The folder of `ltvn dataset`."""
    port: int = 8080
    """Port on 127.0.0.1; 0 takes any free one."""
    weights: Path | None = None
    """Weights to use instead of the shipped ones."""

    def run(self) -> Summary:
        """Serve the page until interrupted; raises DatasetError, WeightsError and ServerError."""
        from ltvn_viz.pairs.pairs_app import PairsOptions, run_pairs_app

        run_pairs_app(PairsOptions(self.folder, self.port, self.weights), say=_LOG.info)
        return PairsSummary(self.folder)
