"""Chooses device and number format for training, by a short measurement, and says what it chose.

Owns the choice. Matching and geometry stay in float32 whatever is chosen: only the encoder is worth less precision.
"""

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from ltvn_core.model.features import ImageFeatures
from ltvn_core.model.network import PairNetwork

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Precision:
    """How the encoder computes."""

    bfloat16: bool

    def encode(self, network: PairNetwork, rgb: Tensor, depth: Tensor) -> ImageFeatures:
        """Encode images and return float32 features."""
        with torch.autocast(rgb.device.type, torch.bfloat16, enabled=self.bfloat16):
            features = network.encode(rgb, depth)
        return ImageFeatures(*(part.float() for part in features))


def choose_precision(network: PairNetwork, *, images: int = 48) -> Precision:
    """Return bfloat16 where a training step of the encoder is at least a tenth faster with it."""
    rgb, depth = torch.rand(images, 3, 72, 96), torch.rand(images, 72, 96) * 4 + 0.5
    seconds = {}
    state = {name: value.clone() for name, value in network.state_dict().items()}
    for bfloat16 in (False, True):
        step = _encoder_step(network, Precision(bfloat16), rgb, depth)
        step()
        seconds[bfloat16] = min(_seconds(step) for _ in range(2))
    network.load_state_dict(state)  # Batch normalisation has seen noise meanwhile.
    network.zero_grad(set_to_none=True)
    choice = Precision(seconds[True] < 0.9 * seconds[False])
    log.info(
        "encoder step: %.2f ms per image in float32, %.2f in bfloat16; taking %s on %d threads",
        seconds[False] / images * 1e3,
        seconds[True] / images * 1e3,
        "bfloat16" if choice.bfloat16 else "float32",
        torch.get_num_threads(),
    )
    return choice


def _encoder_step(network: PairNetwork, precision: Precision, rgb: Tensor, depth: Tensor) -> Callable[[], None]:
    def step() -> None:
        features = precision.encode(network, rgb, depth)
        torch.stack([features.descriptors.mean(), features.points.mean(), features.values.mean()]).sum().backward()

    return step


def _seconds(step: Callable[[], None]) -> float:
    start = time.perf_counter()
    step()
    return time.perf_counter() - start
