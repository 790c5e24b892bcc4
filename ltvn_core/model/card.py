"""The card that travels with weights: what they were trained on, how, and how good they are.

Owns the card's fields. `ltvn_core.model.weights` writes it beside the weights.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from ltvn_core.model.driving import MeasuredDriving
from ltvn_core.model.figures import DriveFigures, PairFigures
from ltvn_core.model.training import TrainingPlan


@dataclass(frozen=True)
class TrainedOn:
    """The data behind weights."""

    scenes: tuple[str, ...]
    """Scenes learned from."""
    validation_scenes: tuple[str, ...]
    """Scenes by which the best weights and the calibration were chosen."""
    images: int
    """Images learned from."""
    pairs: int
    """Labelled pairs of them."""
    recipe: str
    """Settings of the dataset, as JSON."""


@dataclass(frozen=True)
class Measured:
    """Figures on scenes that neither training nor the choice of weights has seen."""

    scenes: tuple[str, ...]
    pairs: PairFigures
    """On the pairs of a dataset: neighbours within 2.5 m, many of them on the edge of being reachable."""
    drive_pairs: PairFigures
    """On all ordered image pairs of one drive per scene."""
    drives: DriveFigures
    """On the near and on the far ones of the latter."""


@dataclass(frozen=True)
class Card:
    """All that is known of a set of weights."""

    trained_on: TrainedOn
    plan: TrainingPlan
    steps: int
    """Steps of training."""
    pairs_compared: int
    """Pairs compared in training."""
    minutes: float
    """Time of training."""
    processes: int
    """Processes that trained together."""
    commands: Sequence[str]
    """What makes these weights again, up to the time that training took elsewhere."""
    measured: Measured
    driving: MeasuredDriving | None = None
    """What Eq. 3 and Eq. 4 take their constants from; None until `ltvn measure --write` has run."""
