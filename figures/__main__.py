"""`python -m figures`: the pictures and tables of `docs/network.md`, from shards, weights and their card."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ltvn_core.cli import run_verb
from ltvn_core.extras import require_libraries
from ltvn_core.training.held_out_scenes import TEST_SCENES, drives
from ltvn_core.training.simulated_scenes import open_dataset_scene
from ltvn_core.verbs.verb import Summary, Verb

if TYPE_CHECKING:
    from ltvn_core.network.training_data.shards import Shard


@dataclass(frozen=True)
class FiguresSummary:
    """What was drawn."""

    pictures: tuple[Path, ...]
    page: Path | None
    fingerprint: str
    pairs: int
    """Labelled pairs behind the pictures."""


@dataclass(frozen=True, kw_only=True)
class FiguresVerb(Verb):
    """Draw all pictures about the network, and write the card's figures into their page."""

    weights: Path | None = None
    """Weights to draw; the shipped ones unless named."""
    data: Path = Path("data")
    """Folder of the dataset; pairs of the unseen scenes are kept in `unseen` below it, as `ltvn train` does."""
    output: Path = Path("docs/images/network")
    """Where the pictures go."""
    page: Path | None = Path("docs/network.md")
    """The page whose tables are written."""
    measurements: Path = Path("docs/measurements")
    """Folder of summaries of `ltvn train --evaluate`, for the page's comparisons."""
    tables_only: bool = False
    """Draw nothing, only write the page's tables anew."""
    scenes: tuple[str, ...] = TEST_SCENES
    """Scenes that training has not seen."""
    clusters: int = 180
    """Clusters of images per scene."""
    images: int = 300
    """Images of the drive through each scene."""

    def run(self) -> Summary:
        """Draw and write; raises OptionError, WeightsError, SceneError and DatasetError."""
        from figures.baseline_tables import baseline_blocks
        from figures.network_comparisons import comparison_tables
        from figures.network_tables import network_blocks
        from ltvn_core.network.shipped_weights import SHIPPED_WEIGHTS
        from ltvn_core.network.weights_file import read_card, weights_fingerprint
        from ltvn_core.systems.registry import baseline_systems
        from tools.results_page import fill_blocks

        weights = self.weights or SHIPPED_WEIGHTS
        rivals = {entry.name: read_card(entry.weights) for entry in baseline_systems()}
        tables = {**network_blocks(read_card(weights)), **baseline_blocks(rivals)}
        pictures, pairs = ((), 0) if self.tables_only else self._draw(weights)
        if self.page is not None:
            fill_blocks(self.page, {**tables, **comparison_tables(self.measurements)})
        return FiguresSummary(pictures, self.page, weights_fingerprint(weights), pairs)

    def _draw(self, weights: Path) -> tuple[tuple[Path, ...], int]:
        """Return the pictures and the number of labelled pairs behind them."""
        require_libraries("matplotlib", "jinja2")
        from figures.network_figures import draw_network_figures
        from ltvn_core.evaluation.reports.figure_style import FIGURE_PALETTE
        from ltvn_core.network.predictor import load_predictor

        predictor, shards = load_predictor(weights), self._shards()
        pictures = draw_network_figures(
            predictor, shards, drives(self.scenes, images=self.images), FIGURE_PALETTE, self.output
        )
        return pictures, sum(len(shard.sources) for shard in shards)

    def _shards(self) -> "list[Shard]":
        from ltvn_core.network.training_data.shards import DatasetRecipe, generate_shards, read_shard

        recipe = DatasetRecipe(clusters=self.clusters)
        return [
            read_shard(path) for path in generate_shards(self.scenes, open_dataset_scene, self.data / "unseen", recipe)
        ]


if __name__ == "__main__":
    sys.exit(run_verb("python -m figures", FiguresVerb))
