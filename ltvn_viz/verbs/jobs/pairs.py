"""`ltvn pairs`: look through a dataset's labelled pairs in the browser."""

import logging
from dataclasses import dataclass
from pathlib import Path

from ltvn_core.verbs.verb import Summary
from ltvn_viz.pairs.pairs_app import PairsOptions, run_pairs_app
from ltvn_viz.verbs.pairs import PairsVerb

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class PairsSummary:
    """Summary after the page was closed."""

    folder: Path


def show_pairs(options: PairsVerb) -> Summary:
    """Serve the page until interrupted; raises DatasetError, WeightsError and ServerError."""
    run_pairs_app(PairsOptions(options.folder, options.port, options.weights), say=_LOG.info)
    return PairsSummary(options.folder)
