"""What the network says about scenes it has never seen, as plain arrays for the curves.

Owns which pairs are asked about. The scenes, and the network, come from outside.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from figures.pair_table import PairTable
from ltvn_core.geometry import wrap_angle
from ltvn_core.network.pair_evaluation import LabelledDrive
from ltvn_core.network.predictor import NetworkPredictor
from ltvn_core.network.training_data.shards import Shard


@dataclass(frozen=True, eq=False)
class PairPredictions:
    """Labelled pairs (P,) and what the network says of them."""

    reachability: NDArray[np.float64]
    reachable: NDArray[np.bool_]
    position_error_m: NDArray[np.float64]
    """Means something on reachable pairs only, as does the next."""
    yaw_error_rad: NDArray[np.float64]
    distance_m: NDArray[np.float64]
    overlap: NDArray[np.float64]
    """nan where not measured."""


@dataclass(frozen=True, eq=False)
class DrivePredictions:
    """Reachability of the near (N,) and of the far (M,) pairs of drives."""

    near: NDArray[np.float64]
    far: NDArray[np.float64]


def predict_labelled_pairs(predictor: NetworkPredictor, shards: Sequence[Shard]) -> PairPredictions:
    """Ask about all labelled pairs of shards."""
    parts = []
    for shard in shards:
        table = PairTable(shard)
        features = predictor.encode_images(shard.rgb, shard.depth_mm)
        ends = shard.sources.astype(np.intp), shard.targets.astype(np.intp)
        said = predictor.predict_rows(features, *ends)
        off = said.waypoints - table.waypoints
        parts.append(
            (
                said.reachability,
                shard.reachable,
                np.hypot(off[:, 0], off[:, 1]),
                np.abs(wrap_angle(off[:, 2])),
                table.distance_m,
                shard.overlap.astype(np.float64),
            )
        )
    return PairPredictions(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def predict_drive_pairs(predictor: NetworkPredictor, drives: Sequence[LabelledDrive]) -> DrivePredictions:
    """Ask about all near and all far ordered pairs of drives, each pair by itself."""
    near = []
    far = []
    for drive in drives:
        features = predictor.encode_images(drive.rgb, drive.depth_mm)
        near.append(predictor.predict_rows(features, *np.nonzero(drive.near)).reachability)
        far.append(predictor.predict_rows(features, *np.nonzero(drive.far)).reachability)
    return DrivePredictions(np.concatenate(near), np.concatenate(far))
