"""The card of weights that learned a rival's labels, and the figures in it.

Owns the card's fields and how a network is judged by labels of time. `ltvn_core.model.weights` writes the card.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ltvn_core.geometry import relative
from ltvn_core.model.assessment import encode_images, predict_pairs
from ltvn_core.model.card import TrainedOn
from ltvn_core.model.examples import Examples
from ltvn_core.model.figures import pair_figures, share
from ltvn_core.model.training import TrainingPlan
from ltvn_core.types import Predictor


@dataclass(frozen=True)
class RivalFigures:
    """How well a network knows a rival's labels."""

    pairs: int
    """Labelled pairs."""
    accuracy: float
    """Share of the labels that a cut of r at 0.5 gets right."""
    auc: float
    ece: float
    """Calibration error of r."""
    position_median_m: float
    """Of the pairs labelled reachable, as are the following."""
    position_p90_m: float
    yaw_median_deg: float


@dataclass(frozen=True)
class RivalCard:
    """All that is known of the weights of a rival."""

    rival: str
    parent: str | None
    """Fingerprint of the weights that training started from: backbone and pose are theirs; None if it began afresh."""
    parent_card: Mapping[str, Any] | None
    """Their card."""
    rule: Mapping[str, Any]
    """The rule that labels pairs."""
    trained_on: TrainedOn
    """Random walks; the figures below are from the validation scenes, which also set the calibration."""
    plan: TrainingPlan
    steps: int
    pairs_compared: int
    minutes: float
    commands: Sequence[str]
    """What makes these weights again, up to the time that training took elsewhere."""
    before: RivalFigures | None
    """Of the weights that training started from, if there were any,"""
    after: RivalFigures
    """and of these."""


def assess_rival(predictor: Predictor, scenes: Sequence[Examples]) -> RivalFigures:
    """Judge a predictor on all labelled pairs of scenes."""
    scores, waypoints = (np.concatenate(part) for part in zip(*(_predict(predictor, s) for s in scenes), strict=True))
    reachable = np.concatenate([scene.reachable for scene in scenes])
    true = np.concatenate([relative(scene.poses[scene.sources], scene.poses[scene.targets]) for scene in scenes])
    found = asdict(pair_figures(scores, waypoints, reachable, true))
    named = {field.name: found[field.name] for field in fields(RivalFigures) if field.name in found}
    return RivalFigures(accuracy=share((scores > 0.5) == reachable), **named)


def _predict(predictor: Predictor, scene: Examples) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    features = encode_images(predictor, scene.rgb, scene.depth_mm)
    return predict_pairs(predictor, features, scene.sources.astype(np.intp), scene.targets.astype(np.intp))
