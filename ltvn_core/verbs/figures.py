"""`ltvn figures`: the pictures and tables of `docs/network.md`, from shards, weights and their card."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ltvn_core.errors import OptionError
from ltvn_core.lessons.unseen import UNSEEN, drives
from ltvn_core.lessons.worlds import open_world
from ltvn_core.verbs.verb import Summary, Verb

if TYPE_CHECKING:
    from ltvn_core.data.shards import Shard
    from ltvn_core.report.style import Ink


@dataclass(frozen=True)
class FiguresMade:
    """What was drawn."""

    pictures: tuple[Path, ...]
    page: Path | None
    fingerprint: str
    pairs: int
    """Labelled pairs behind the pictures."""


@dataclass(frozen=True, kw_only=True)
class Figures(Verb):
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
    scenes: tuple[str, ...] = UNSEEN
    """Scenes that training has not seen."""
    clusters: int = 180
    """Clusters of images per scene."""
    images: int = 300
    """Images of the drive through each scene."""

    def run(self) -> Summary:
        """Draw and write; raises OptionError, WeightsError, SceneError and DatasetError."""
        from ltvn_core.model.weights import SHIPPED, SHIPPED_RIVALS, read_card, weights_fingerprint
        from ltvn_core.report.comparison import comparisons
        from ltvn_core.report.tables import blocks, fill
        from ltvn_core.report.temporal_table import temporal_blocks

        weights = self.weights or SHIPPED
        rivals = {name: read_card(path) for name, path in SHIPPED_RIVALS.items()}
        tables = {**blocks(read_card(weights)), **temporal_blocks(rivals)}
        pictures, pairs = ((), 0) if self.tables_only else self._draw(weights)
        if self.page is not None:
            fill(self.page, {**tables, **comparisons(self.measurements)})
        return FiguresMade(pictures, self.page, weights_fingerprint(weights), pairs)

    def _draw(self, weights: Path) -> tuple[tuple[Path, ...], int]:
        """Return the pictures and the number of labelled pairs behind them."""
        ensure_docs()
        from ltvn_core.model.predictor import load_predictor
        from ltvn_core.report.pictures import draw_all

        predictor, shards = load_predictor(weights), self._shards()
        pictures = draw_all(predictor, shards, drives(self.scenes, images=self.images), ink_on_white(), self.output)
        return pictures, sum(len(shard.sources) for shard in shards)

    def _shards(self) -> "list[Shard]":
        from ltvn_core.data.generate import DatasetRecipe, generate
        from ltvn_core.data.shards import read_shard

        recipe = DatasetRecipe(clusters=self.clusters)
        return [read_shard(path) for path in generate(self.scenes, open_world, self.data / "unseen", recipe)]


def ensure_docs() -> None:
    """Raise OptionError where a library is not installed with which pictures and pages are made."""
    from importlib.util import find_spec

    if missing := [name for name in ("matplotlib", "jinja2") if find_spec(name) is None]:
        raise OptionError(f"Drawing needs {' and '.join(missing)}, which is not installed: pip install 'ltvn[docs]'.")


def ink_on_white() -> "Ink":
    """Return the app's colours, for pictures on white."""
    from ltvn_core.report.style import Ink
    from ltvn_viz import palette

    def on_white(colour: palette.Rgb8) -> tuple[float, float, float]:
        red, green, blue = (0.82 * part / 255 for part in colour)  # The page is dark and needs lighter colours.
        return red, green, blue

    return Ink(on_white(palette.SOURCE), on_white(palette.TARGET), on_white(palette.GOAL))
