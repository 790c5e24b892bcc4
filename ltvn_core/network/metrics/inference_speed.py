"""Measures the size of a network and its speed through the predictor, on this machine, for the model card."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ltvn_core.network.architecture import NETWORK_CAMERA
from ltvn_core.network.base_network import AnyNetwork
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
