"""Validation during training: metrics in scenes that are not trained on, and the weights that are best by them.

Owns the record of a training: `validation.jsonl` and the best weights. The curves for TensorBoard, where it is
installed, nothing reads back.
"""

import json
import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ltvn_core.errors import WeightsError
from ltvn_core.network.base_network import AnyNetwork
from ltvn_core.network.metrics.pair_evaluation import LabelledDrive, evaluate_drives, evaluate_pairs
from ltvn_core.network.metrics.reachability_metrics import DriveMetrics, PairMetrics
from ltvn_core.network.predictor import NetworkPredictor
from ltvn_core.network.training_examples import SceneExamples
from ltvn_core.network.weights_file import save_weights
from ltvn_core.structured_text import parse_json

log = logging.getLogger(__name__)


class TensorBoardLog:
    """Named curves over the steps of one training."""

    def __init__(self, folder: Path) -> None:
        """Write into a folder; does nothing without TensorBoard."""
        self._writer: Any = None
        try:
            from torch.utils.tensorboard import SummaryWriter
        except ImportError:
            log.info("No curves for TensorBoard: it is not installed; `pip install tensorboard` adds it.")
            return
        self._writer = SummaryWriter(folder)
        log.info("Curves: tensorboard --logdir %s", folder)

    def add(self, step: int, **values: float) -> None:
        """Add a point to each of the named curves; two underscores separate group and name."""
        if self._writer is None:
            return
        for name, value in values.items():
            self._writer.add_scalar(name.replace("__", "/"), value, step)

    def add_metrics(self, step: int, group: str, metrics: Mapping[str, float]) -> None:
        """Add a point to each curve of a group."""
        self.add(step, **{f"{group}__{name}": value for name, value in metrics.items()})

    def close(self) -> None:
        """Write pending points and close the file."""
        if self._writer is not None:
            self._writer.close()


@dataclass(frozen=True, slots=True)
class ValidationMetrics:
    """Metrics of one validation."""

    steps: int
    pairs: PairMetrics
    drives: DriveMetrics | None

    @property
    def score(self) -> float:
        """Return the score that decides which weights are best: few false long-range edges first, then AUC and pose."""
        false_edges = 0.0 if self.drives is None else -math.log10(self.drives.far_fpr_at_tpr60 + 1e-5)
        return false_edges + 20 * (self.pairs.auc or 0) - 5 * self.pairs.position_median_m


@dataclass(frozen=True, eq=False)
class ValidationData:
    """The data that weights are compared on, and how many of their pairs."""

    scenes: Sequence[SceneExamples]
    drives: Sequence[LabelledDrive]
    pairs: int
    """Labelled pairs of each scene,"""
    far: int
    """and far pairs of each drive."""


class Validation:
    """Compares the weights of one training, and keeps the best ones and all metrics in its folder."""

    def __init__(self, data: ValidationData, folder: Path, scalars: TensorBoardLog | None) -> None:
        self._data = data
        self._folder = folder
        self._scalars = scalars
        self.weights = folder / "best.safetensors"
        self.best = _read_best(folder / _BEST)
        """Metrics of the best weights so far, also of an interrupted training."""
        self.without_improvement = 0
        """Validations in a row without a better one."""

    def validate(self, network: AnyNetwork, steps: int, *, seconds: float) -> None:
        """Evaluate weights after so many steps and seconds, and keep them if they are the best so far."""
        found = self._evaluate(network, steps)
        log.info("step %d: score %.3f %s %s", found.steps, found.score, found.pairs, found.drives)
        is_best = self.best is None or found.score > self.best.score
        self._write(found, seconds, is_best=is_best)
        if self._scalars is not None:
            self._scalars.add_metrics(found.steps, "pairs", asdict(found.pairs))
            self._scalars.add_metrics(found.steps, "drives", asdict(found.drives) if found.drives else {})
        if is_best:
            self.best = found
            self.without_improvement = 0
            save_weights(network, self.weights)
        else:
            self.without_improvement += 1

    def _evaluate(self, network: AnyNetwork, steps: int) -> ValidationMetrics:
        predictor, data = NetworkPredictor(network, "in training"), self._data
        # The same pairs in every validation, so that scores are comparable.
        rng = np.random.default_rng(0)
        return ValidationMetrics(
            steps,
            evaluate_pairs(predictor, data.scenes, rng, limit=data.pairs),
            evaluate_drives(predictor, data.drives, rng, limit=data.far) if data.drives else None,
        )

    def _write(self, found: ValidationMetrics, seconds: float, *, is_best: bool) -> None:
        """Append metrics to the log in the folder, and save them separately if they are the best so far."""
        line = json.dumps({"seconds": round(seconds), "score": found.score, **asdict(found)})
        try:
            with (self._folder / "validation.jsonl").open("a", encoding="utf-8") as file:
                file.write(line + "\n")
            if is_best:
                (self._folder / _BEST).write_text(json.dumps(asdict(found)), encoding="utf-8")
        except OSError as error:
            raise WeightsError(
                f"{self._folder}: figures could not be written ({error}); free some space and run again, which goes "
                "on from the last checkpoint."
            ) from error


_BEST = "best.json"


def _read_best(path: Path) -> ValidationMetrics | None:
    """Return the metrics of the best weights of an interrupted training."""
    try:
        found = parse_json(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    drives = DriveMetrics(**found["drives"]) if found["drives"] else None
    return ValidationMetrics(found["steps"], PairMetrics(**found["pairs"]), drives)
