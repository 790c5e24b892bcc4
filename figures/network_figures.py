"""All pictures of the page about the network, by name."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from figures.network_curves import calibration_figure, false_long_range_figure, pose_error_figure
from figures.network_predictions import predict_drive_pairs, predict_labelled_pairs
from figures.network_schematic import network_schematic
from figures.pair_gallery import pair_gallery, reachable_rows, unreachable_rows
from ltvn_core.evaluation.reports.figure_style import FigurePalette, documentation_style, save_png
from ltvn_core.network.architecture import PairArchitecture
from ltvn_core.network.pair_evaluation import LabelledDrive
from ltvn_core.network.predictor import NetworkPredictor
from ltvn_core.network.training_data.shards import Shard


def draw_network_figures(
    predictor: NetworkPredictor,
    shards: Sequence[Shard],
    drives: Sequence[LabelledDrive],
    palette: FigurePalette,
    folder: Path,
) -> tuple[Path, ...]:
    """Draw everything about a network on unseen shards and drives; returns the files. Raises OptionError.

    A network of another family is drawn as the shipped one.
    """
    size = predictor.architecture
    rng = np.random.default_rng(0)
    said = predict_labelled_pairs(predictor, shards)
    driven = predict_drive_pairs(predictor, drives)
    with documentation_style(palette):
        figures = {
            "reachable": pair_gallery(reachable_rows(shards, rng), palette),
            "unreachable": pair_gallery(unreachable_rows(shards, rng), palette),
            "network": network_schematic(size if isinstance(size, PairArchitecture) else PairArchitecture(), palette),
            "calibration": calibration_figure(said, palette),
            "errors": pose_error_figure(said, palette),
            "wormholes": false_long_range_figure(driven, palette),
        }
        return tuple(save_png(figure, folder / f"{name}.png") for name, figure in figures.items())
