"""State of the pair viewer: the scene, the filter, the pair on show, and the network's prediction for it.

Owns this state, but no widgets. For one thread at a time.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ltvn_core.errors import DatasetError
from ltvn_core.network.pair_evaluation import encode_images, predict_pairs
from ltvn_core.network.training_data.pair_table import (
    FailureExplanation,
    LabelledPair,
    PairFilter,
    PairTable,
    limits_from_recipe,
    reasons,
)
from ltvn_core.network.training_data.shards import SHARD_SUFFIX, dataset_shards, read_shard, shard_scene
from ltvn_core.types import Predictor, Waypoint


@dataclass(frozen=True, slots=True)
class OpenScene:
    """Open the shard of another scene."""

    name: str


@dataclass(frozen=True, slots=True)
class StepPairs:
    """Move forwards in the list of pairs, or backwards if the number is negative."""

    by: int


@dataclass(frozen=True, slots=True)
class JumpToRandomPair:
    """Show a random pair of the list."""


PairCommand: TypeAlias = OpenScene | PairFilter | StepPairs | JumpToRandomPair


@dataclass(frozen=True, eq=False)
class ShownPair:
    """The pair on show, with the network's prediction for it."""

    pair: LabelledPair | None
    """The labelled pair; None if no pair passes the filter."""
    number: int
    """Position of the pair in the list, from 1; 0 if the list is empty."""
    count: int
    """Number of pairs in the list."""
    reachability: float = 0.0
    """r that the network predicts for the pair."""
    waypoint: Waypoint = field(default_factory=lambda: np.zeros(3))
    """(3,) waypoint that the network predicts."""
    reasons: tuple[FailureExplanation, ...] = ()
    """Reasons why the pair is not reachable."""

    @property
    def agrees(self) -> bool:
        """Tell whether network and label agree."""
        return self.pair is not None and (self.reachability > 0.5) == self.pair.reachable


def scenes_in(folder: Path) -> dict[str, Path]:
    """Return the shards of a folder by scene. Raises DatasetError if there are none."""
    found = {shard_scene(path): path for path in dataset_shards(folder)}
    if not found:
        raise DatasetError(
            f"{folder}: holds no shards (*{SHARD_SUFFIX}); make some with `ltvn dataset --folder {folder}`."
        )
    return found


class PairBrowser:
    """Browses the pairs of a folder of shards, one scene at a time."""

    def __init__(self, paths: dict[str, Path], predictor: Predictor) -> None:
        """Open the first scene. Raises DatasetError."""
        self._paths = paths
        self._predictor = predictor
        self._rng = np.random.default_rng(0)
        self._pair_filter = PairFilter()
        self._open(next(iter(paths)))

    @property
    def scenes(self) -> Sequence[str]:
        """Return the names of all scenes."""
        return tuple(self._paths)

    def is_slow(self, command: PairCommand) -> bool:
        """Tell whether a command first needs the network's predictions for all pairs of a scene."""
        new_scene = isinstance(command, OpenScene) and self._pair_filter.only_disagreements
        return new_scene or (
            isinstance(command, PairFilter) and command.only_disagreements and self._reachability is None
        )

    def handle(self, command: PairCommand) -> None:
        """Run a command. Raises DatasetError if a shard cannot be read."""
        match command:
            case OpenScene(name):
                self._open(name)
            case PairFilter():
                self._pair_filter = command
                self._filter()
            case StepPairs(by):
                self._place = (self._place + by) % max(len(self._rows), 1)
            case JumpToRandomPair():
                self._place = int(self._rng.integers(max(len(self._rows), 1)))

    def shown_pair(self) -> ShownPair:
        """Return the pair on show."""
        if len(self._rows) == 0:
            return ShownPair(None, 0, 0)
        pair = self._table.pair(int(self._rows[self._place]))
        shard = self._table.shard
        ends = [pair.source, pair.target]
        features = encode_images(self._predictor, shard.rgb[ends], shard.depth_mm[ends])
        said = self._predictor.predict(features[:1], features[1:])
        why = reasons(pair, limits_from_recipe(shard.recipe))
        return ShownPair(pair, self._place + 1, len(self._rows), float(said.reachability[0]), said.waypoints[0], why)

    def _open(self, name: str) -> None:
        self._table = PairTable(read_shard(self._paths[name]))
        self._reachability: NDArray[np.float64] | None = None
        self._filter()

    def _filter(self) -> None:
        if self._pair_filter.only_disagreements and self._reachability is None:
            self._reachability = self._judge_all()
        self._rows = self._table.rows(self._pair_filter, self._reachability)
        self._place = 0

    def _judge_all(self) -> NDArray[np.float64]:
        shard = self._table.shard
        features = encode_images(self._predictor, shard.rgb, shard.depth_mm)
        ends = shard.sources.astype(np.intp), shard.targets.astype(np.intp)
        return predict_pairs(self._predictor, features, *ends).reachability
