"""The model card of trained weights: training data, settings, metrics, size and speed.

Owns the measurement of size and speed on this machine. `ltvn_core.network.weights_file` writes the card beside the
weights.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ltvn_core.network.architecture import NETWORK_CAMERA
from ltvn_core.network.base_network import AnyNetwork
from ltvn_core.network.driving_calibration import DrivingMeasurements
from ltvn_core.network.metrics import DriveMetrics, PairMetrics
from ltvn_core.network.optimization.training_loop import TrainingPlan
from ltvn_core.network.predictor import NetworkPredictor
from ltvn_core.types import Observation

_FARTHEST_M = 5.0


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
    """Measure a network on random images, with as many pairs as images; the fastest of several repeats counts."""
    predictor = NetworkPredictor(network, "in measurement", prefilter_from=None)
    observations = _noise(images)
    features = predictor.encode(observations)
    return InferenceSpeed(
        sum(each.numel() for each in network.parameters()),
        _fastest_ms(lambda: predictor.encode(observations), repeats) / images,
        _fastest_ms(lambda: predictor.predict(features, features[::-1]), repeats) / images,
    )


def _noise(images: int) -> list[Observation]:
    rng = np.random.default_rng(0)
    nowhere = np.zeros(3)
    shape = (NETWORK_CAMERA.height, NETWORK_CAMERA.width)
    return [
        Observation(
            rgb=rng.integers(0, 256, (*shape, 3), dtype=np.uint8),
            depth=rng.uniform(0, _FARTHEST_M, shape).astype(np.float32),
            odometry=nowhere,
            stamp=0.0,
            step=step,
        )
        for step in range(images)
    ]


def _fastest_ms(work: Callable[[], object], repeats: int) -> float:
    seconds = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - start)
    return 1e3 * min(seconds)


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
