"""All pictures of the page about the network, by name."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ltvn_core.data.shards import Shard
from ltvn_core.model.architecture import Architecture
from ltvn_core.model.assessment import Drive
from ltvn_core.model.predictor import NetworkPredictor
from ltvn_core.report.curves import calibration, errors, wormholes
from ltvn_core.report.evidence import ask_about_drives, ask_about_pairs
from ltvn_core.report.gallery import gallery, reachable_rows, unreachable_rows
from ltvn_core.report.schematic import schematic
from ltvn_core.report.style import Ink, drawing, save


def draw_all(
    predictor: NetworkPredictor, shards: Sequence[Shard], drives: Sequence[Drive], ink: Ink, folder: Path
) -> tuple[Path, ...]:
    """Draw everything about a network on unseen shards and drives; returns the files. Raises OptionError.

    A network of another family is drawn as the shipped one.
    """
    size = predictor.architecture
    rng, said, driven = (
        np.random.default_rng(0),
        ask_about_pairs(predictor, shards),
        ask_about_drives(predictor, drives),
    )
    with drawing(ink):
        figures = {
            "reachable": gallery(reachable_rows(shards, rng), ink),
            "unreachable": gallery(unreachable_rows(shards, rng), ink),
            "network": schematic(size if isinstance(size, Architecture) else Architecture(), ink),
            "calibration": calibration(said, ink),
            "errors": errors(said, ink),
            "wormholes": wormholes(driven, ink),
        }
        return tuple(save(figure, folder / f"{name}.png") for name, figure in figures.items())
