"""The model card of trained weights: training data, settings, metrics, size and speed.

`ltvn_core.network.weights_file` writes the card beside the weights.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from timeit import repeat

import numpy as np

from ltvn_core.network.architecture import NETWORK_CAMERA
from ltvn_core.network.base_network import AnyNetwork
from ltvn_core.network.driving_calibration import DrivingMeasurements
from ltvn_core.network.metrics import DriveMetrics, PairMetrics
from ltvn_core.network.optimization.training_loop import TrainingPlan
from ltvn_core.network.predictor import NetworkPredictor

_FARTHEST_MM = 5000


@dataclass(frozen=True, slots=True)
class InferenceSpeed:
    """Size of a network, and its times on the CPU of the machine that trained it."""

    parameters: int
    """Number of trainable parameters."""
    encode_ms: float
    """Milliseconds per image, in batches."""
    pair_ms: float
    """Milliseconds per pair of encoded images, in batches and without a prefilter."""


def measure_speed(network: AnyNetwork, *, images: int = 64, repeats: int = 3) -> InferenceSpeed:
    """Measure a network on random images, with as many pairs as images, and return the fastest of several repeats."""
    predictor = NetworkPredictor(network, "in measurement", prefilter_from=None)
    rng = np.random.default_rng(0)
    shape = (images, NETWORK_CAMERA.height, NETWORK_CAMERA.width)
    rgb, depth_mm = rng.integers(0, 256, (*shape, 3), np.uint8), rng.integers(0, _FARTHEST_MM, shape, np.uint16)
    features = predictor.encode_images(rgb, depth_mm)
    encode_s = min(repeat(lambda: predictor.encode_images(rgb, depth_mm), number=1, repeat=repeats))
    pair_s = min(repeat(lambda: predictor.predict(features, features[::-1]), number=1, repeat=repeats))
    parameters = sum(each.numel() for each in network.parameters())
    return InferenceSpeed(parameters, 1e3 * encode_s / images, 1e3 * pair_s / images)


@dataclass(frozen=True)
class TrainingDataSummary:
    """Summary of the training data."""

    scenes: tuple[str, ...]
    """Training scenes."""
    validation_scenes: tuple[str, ...]
    """Validation scenes, used to choose the best weights and the calibration."""
    images: int
    """Number of training images."""
    pairs: int
    """Number of labelled pairs of training images."""
    recipe: str
    """Settings of the dataset, as JSON."""


@dataclass(frozen=True)
class HeldOutMetrics:
    """Metrics on scenes that were used neither for training nor for the choice of weights."""

    scenes: tuple[str, ...]
    pairs: PairMetrics
    """Metrics on the pairs of a dataset: neighbours within 2.5 m, many of them only just reachable or unreachable."""
    drive_pairs: PairMetrics
    """Metrics on all ordered image pairs of one drive per scene."""
    drives: DriveMetrics
    """Metrics on the near and far pairs of these drives."""


@dataclass(frozen=True)
class ModelCard:
    """The model card of a set of weights."""

    trained_on: TrainingDataSummary
    plan: TrainingPlan
    """Settings of the training, with the architecture."""
    steps: int
    """Number of training steps."""
    pairs_compared: int
    """Number of pairs compared in training."""
    minutes: float
    """Training time in minutes."""
    commands: Sequence[str]
    """Commands that reproduce these weights, up to differences in training time."""
    speed: InferenceSpeed
    """Size of the network, and its inference times on the machine that trained it."""
    measured: HeldOutMetrics
    driving: DrivingMeasurements | None = None
    """Driving measurements, the source of the constants of Eq. 3 and Eq. 4; None if not measured."""
