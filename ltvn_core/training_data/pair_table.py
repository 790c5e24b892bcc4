"""The pairs of a shard as a table that can be filtered.

`failure_explanations` puts failed criteria into words.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ltvn_core.geometry import relative
from ltvn_core.training_data.reachability_labels import FailedCriteria
from ltvn_core.training_data.shards import Shard
from ltvn_core.types import Depth, Rgb, Waypoint


@dataclass(frozen=True, slots=True)
class PairFilter:
    """Conditions for the pairs to show."""

    reachable: bool | None = None
    """Only pairs with this label; None for both labels."""
    criterion: FailedCriteria = FailedCriteria.NOTHING
    """Only pairs that fail this criterion; NOTHING for all pairs."""
    min_distance_m: float = 0.0
    """Least distance,"""
    max_distance_m: float = float("inf")
    """and greatest distance between source and target."""
    only_disagreements: bool = False
    """Only pairs for which the network contradicts the label."""


@dataclass(frozen=True, eq=False)
class LabelledPair:
    """One row of the table with its two images."""

    scene: str
    source: int
    """Row of the source image in its shard."""
    target: int
    """Row of the target image in its shard."""
    source_rgb: Rgb
    source_depth: Depth
    target_rgb: Rgb
    target_depth: Depth
    waypoint: Waypoint
    """(3,) true pose of the target in the source's frame."""
    reachable: bool
    failed: FailedCriteria
    overlap: float
    """Share of the target's points that the source sees; nan where not measured."""
    path_ratio: float
    """Length of the path against the straight line; nan where not measured."""

    @property
    def distance_m(self) -> float:
        """Straight distance in metres."""
        return float(np.hypot(self.waypoint[0], self.waypoint[1]))


class PairTable:
    """All pairs of one shard."""

    def __init__(self, shard: Shard) -> None:
        self.shard = shard
        self.waypoints: Waypoint = relative(shard.poses[shard.sources], shard.poses[shard.targets])
        self.distance_m: NDArray[np.float64] = np.hypot(self.waypoints[:, 0], self.waypoints[:, 1])

    def __len__(self) -> int:
        """Return the number of pairs."""
        return len(self.distance_m)

    def rows(self, pair_filter: PairFilter, reachability: NDArray[np.float64] | None = None) -> NDArray[np.intp]:
        """Return the rows (M,) of the pairs that meet a filter, in the order of the shard.

        Args:
            pair_filter: The conditions.
            reachability: (P,) predictions of the network, needed for `only_disagreements`.

        Raises:
            ValueError: `reachability` is needed and missing.
        """
        shard = self.shard
        chosen = (self.distance_m >= pair_filter.min_distance_m) & (self.distance_m <= pair_filter.max_distance_m)
        if pair_filter.reachable is not None:
            chosen &= shard.reachable == pair_filter.reachable
        if pair_filter.criterion:
            chosen &= (shard.failed & int(pair_filter.criterion)) != 0
        if pair_filter.only_disagreements:
            if reachability is None:
                raise ValueError("Disagreements with the network need its reachability of all pairs.")
            chosen &= (reachability > 0.5) != shard.reachable
        return np.flatnonzero(chosen)

    def pair(self, row: int) -> LabelledPair:
        """Return one pair with its images."""
        shard = self.shard
        i = int(shard.sources[row])
        j = int(shard.targets[row])
        return LabelledPair(
            scene=shard.name,
            source=i,
            target=j,
            source_rgb=shard.rgb[i],
            source_depth=shard.depth_mm[i] / np.float32(1000),
            target_rgb=shard.rgb[j],
            target_depth=shard.depth_mm[j] / np.float32(1000),
            waypoint=self.waypoints[row],
            reachable=bool(shard.reachable[row]),
            failed=FailedCriteria(int(shard.failed[row])),
            overlap=float(shard.overlap[row]),
            path_ratio=float(shard.path_ratio[row]),
        )
