"""Baselines: the training plans, the evaluation and the model card of their networks.

A baseline learns from time alone, so it must not use poses or maps. Its training plans are those of our network without
hard-negative mining, and no pair within one scene counts as far because of its poses.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

import numpy as np

from ltvn_core.network.architecture import PairArchitecture
from ltvn_core.network.metrics import pair_metrics, share
from ltvn_core.network.model_card import TrainingDataSummary
from ltvn_core.network.optimization.fine_tuning_loop import FineTuningPlan
from ltvn_core.network.optimization.trainer import Hyperparameters
from ltvn_core.network.optimization.training_loop import TrainingPlan
from ltvn_core.network.pair_evaluation import compare_labelled
from ltvn_core.network.predictor import NetworkPredictor
from ltvn_core.network.training_examples import FarCriterion, SceneExamples

_ONLY_OTHER_SCENES = FarCriterion(distance_m=1e6, yaw_rad=4.0)
"""Limits larger than any scene, so that only pairs of different scenes are far."""


def baseline_hyperparameters(learning: Hyperparameters, *, even_distances: bool) -> Hyperparameters:
    """Return hyperparameters for a baseline; without `even_distances` it draws pairs as often as they occur."""
    evened = even_distances and learning.evened
    return replace(learning, far=_ONLY_OTHER_SCENES, confusions=0, hardness=0.0, evened=evened)


def baseline_training_plan(
    *, even_distances: bool, minutes: float, steps: int | None, seed: int, fresh: bool = False
) -> TrainingPlan:
    """Return the training plan of a baseline (all values are ours).

    Training starts from trained weights or, if `fresh`, from random ones, and lasts for `minutes` unless `steps` is
    given.
    """
    rate = 2e-3 if fresh else 5e-4
    learning = Hyperparameters(
        seed=seed, groups=6, pairs_per_group=30, hard=24, random=0, rate=rate, warm_up=0.1, average=0.99
    )
    plan = TrainingPlan(
        learning=baseline_hyperparameters(learning, even_distances=even_distances),
        architecture=PairArchitecture(),
        minutes=minutes,
        validations=3,
        minings=0,
    )
    return plan if steps is None else replace(plan, minutes=None, steps=steps)


def baseline_fine_tuning_plan(plan: FineTuningPlan, *, even_distances: bool) -> FineTuningPlan:
    """Return a fine-tuning plan that uses neither poses nor mined pairs."""
    return replace(plan, learning=baseline_hyperparameters(plan.learning, even_distances=even_distances), minings=0)


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
    """Median position error of the pairs labelled reachable."""
    position_p90_m: float
    """90th percentile of the position error of the pairs labelled reachable."""
    yaw_median_deg: float
    """Median yaw error of the pairs labelled reachable."""


@dataclass(frozen=True)
class BaselineCard:
    """The model card of the weights of a baseline."""

    rival: str
    parent: str | None
    """Fingerprint of the weights that training started from; None if it started from random ones."""
    parent_card: Mapping[str, Any] | None
    """Card of the parent weights; None without a parent, or if the new file adds layers to the parent's file."""
    rule: Mapping[str, Any]
    """The rule that labels pairs."""
    trained_on: TrainingDataSummary
    """Summary of the random walks; the metrics below are from the validation scenes, which also calibrate r."""
    plan: TrainingPlan
    steps: int
    pairs_compared: int
    minutes: float
    commands: Sequence[str]
    """Commands that reproduce these weights, up to differences in training time."""
    before: BaselineMetrics | None
    """Metrics of the weights that training started from; None if it started from none."""
    after: BaselineMetrics
    """Metrics of the new weights."""


def evaluate_baseline(predictor: NetworkPredictor, scenes: Sequence[SceneExamples]) -> BaselineMetrics:
    """Evaluate a network on all labelled pairs of scenes."""
    parts = [compare_labelled(predictor, scene, np.arange(len(scene.sources))) for scene in scenes]
    scores, waypoints, reachable, true = (np.concatenate(column) for column in zip(*parts, strict=True))
    found = asdict(pair_metrics(scores, waypoints, reachable, true))
    named = {field.name: found[field.name] for field in fields(BaselineMetrics) if field.name in found}
    return BaselineMetrics(accuracy=share((scores > 0.5) == reachable), **named)
