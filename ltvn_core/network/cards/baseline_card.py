"""The model card of a baseline's weights, and the evaluation on the baseline's labels of time.

`ltvn_core.network.weights_file` writes the card.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ltvn_core.geometry import relative
from ltvn_core.network.cards.model_card import TrainingDataSummary
from ltvn_core.network.metrics.pair_evaluation import encode_images, predict_pairs
from ltvn_core.network.metrics.reachability_metrics import pair_metrics, share
from ltvn_core.network.optimization.training_loop import TrainingPlan
from ltvn_core.network.training_examples import SceneExamples
from ltvn_core.types import Predictor


@dataclass(frozen=True)
class BaselineMetrics:
    """Metrics of a network on the labels of a baseline."""

    pairs: int
    """Labelled pairs."""
    accuracy: float
    """Share of the labels that a threshold of 0.5 on r predicts correctly."""
    auc: float
    ece: float
    """Calibration error of r."""
    position_median_m: float
    """Median position error of the pairs labelled reachable, as the following fields."""
    position_p90_m: float
    yaw_median_deg: float


@dataclass(frozen=True)
class BaselineCard:
    """The model card of the weights of a baseline."""

    rival: str
    parent: str | None
    """Fingerprint of the weights that training started from: backbone and pose are theirs; None if it began afresh."""
    parent_card: Mapping[str, Any] | None
    """Their card; None also where the new ones add layers to them, so that they are needed beside."""
    rule: Mapping[str, Any]
    """The rule that labels pairs."""
    trained_on: TrainingDataSummary
    """Random walks; the metrics below are from the validation scenes, on which r is also calibrated."""
    plan: TrainingPlan
    steps: int
    pairs_compared: int
    minutes: float
    commands: Sequence[str]
    """What makes these weights again, up to the time that training took elsewhere."""
    before: BaselineMetrics | None
    """Of the weights that training started from, if there were any,"""
    after: BaselineMetrics
    """and of these."""


def evaluate_baseline(predictor: Predictor, scenes: Sequence[SceneExamples]) -> BaselineMetrics:
    """Evaluate a predictor on all labelled pairs of scenes."""
    scores, waypoints = (np.concatenate(part) for part in zip(*(_predict(predictor, s) for s in scenes), strict=True))
    reachable = np.concatenate([scene.reachable for scene in scenes])
    true = np.concatenate([relative(scene.poses[scene.sources], scene.poses[scene.targets]) for scene in scenes])
    found = asdict(pair_metrics(scores, waypoints, reachable, true))
    named = {field.name: found[field.name] for field in fields(BaselineMetrics) if field.name in found}
    return BaselineMetrics(accuracy=share((scores > 0.5) == reachable), **named)


def _predict(predictor: Predictor, scene: SceneExamples) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    features = encode_images(predictor, scene.rgb, scene.depth_mm)
    return predict_pairs(predictor, features, scene.sources.astype(np.intp), scene.targets.astype(np.intp))
