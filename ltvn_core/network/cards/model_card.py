"""The model card of trained weights: training data, settings and metrics.

`ltvn_core.network.weights_file` writes it beside the weights.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from ltvn_core.network.cards.driving_calibration import DrivingMeasurements
from ltvn_core.network.metrics.inference_speed import InferenceSpeed
from ltvn_core.network.metrics.reachability_metrics import DriveMetrics, PairMetrics
from ltvn_core.network.optimization.training_loop import TrainingPlan


@dataclass(frozen=True)
class TrainingDataSummary:
    """Summary of the training data."""

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
class HeldOutMetrics:
    """Metrics on scenes that were used neither for training nor for the choice of weights."""

    scenes: tuple[str, ...]
    pairs: PairMetrics
    """On the pairs of a dataset: neighbours within 2.5 m, many of them on the edge of being reachable."""
    drive_pairs: PairMetrics
    """On all ordered image pairs of one drive per scene."""
    drives: DriveMetrics
    """On the near and the far pairs of these drives."""


@dataclass(frozen=True)
class ModelCard:
    """The model card of a set of weights."""

    trained_on: TrainingDataSummary
    plan: TrainingPlan
    """Settings of the training, with the architecture."""
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
    speed: InferenceSpeed
    """Size of the network and its times where it was trained."""
    measured: HeldOutMetrics
    driving: DrivingMeasurements | None = None
    """What Eq. 3 and Eq. 4 take their constants from; None until `ltvn measure --write` has run."""
