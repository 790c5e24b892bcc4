"""Chooses the precision for training by a short measurement.

Networks compute in float32 what needs it (`PairNetwork`: matching and geometry).
"""

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from ltvn_core.network.architecture import NETWORK_CAMERA
from ltvn_core.network.base_network import BaseNetwork
from ltvn_core.network.device import device_of
from ltvn_core.network.image_features import FeaturesT, to_float32
from ltvn_core.network.pair_head import PairOutput

log = logging.getLogger(__name__)

_IMAGES = 48
"""Of the step that is timed, and as many pairs."""


@dataclass(frozen=True, slots=True)
class MixedPrecision:
    """Runs a network in a given precision."""

    bfloat16: bool

    def encode(self, network: BaseNetwork[FeaturesT], rgb: Tensor, depth: Tensor) -> FeaturesT:
        """Encode images and return float32 features."""
        with torch.autocast(rgb.device.type, torch.bfloat16, enabled=self.bfloat16):
            features = network.encode(rgb, depth)
        return to_float32(features)

    def compare(self, network: BaseNetwork[FeaturesT], source: FeaturesT, target: FeaturesT) -> PairOutput:
        """Compare P sources with P targets and return float32 outputs."""
        with torch.autocast(device_of(network).type, torch.bfloat16, enabled=self.bfloat16):
            output = network.compare(source, target)
        return output._replace(logit=output.logit.float(), pose=output.pose.float())


def choose_precision(network: BaseNetwork[FeaturesT]) -> MixedPrecision:
    """Return bfloat16 where a training step on as many pairs as images is at least a tenth faster with it."""
    device = device_of(network)
    rgb = torch.rand(_IMAGES, 3, NETWORK_CAMERA.height, NETWORK_CAMERA.width, device=device)
    depth = torch.rand(_IMAGES, NETWORK_CAMERA.height, NETWORK_CAMERA.width, device=device) * 4 + 0.5
    seconds = {}
    state = {name: value.clone() for name, value in network.state_dict().items()}
    for bfloat16 in (False, True):
        step = _training_step(network, MixedPrecision(bfloat16), rgb, depth)
        step()
        seconds[bfloat16] = min(_seconds(step) for _ in range(2))
    network.load_state_dict(state)  # Batch normalisation has seen noise meanwhile.
    network.zero_grad(set_to_none=True)
    choice = MixedPrecision(seconds[True] < 0.9 * seconds[False])
    log.info(
        "training step: %.2f ms per image in float32, %.2f in bfloat16; taking %s on %d threads",
        seconds[False] / _IMAGES * 1e3,
        seconds[True] / _IMAGES * 1e3,
        "bfloat16" if choice.bfloat16 else "float32",
        torch.get_num_threads(),
    )
    return choice


def _training_step(
    network: BaseNetwork[FeaturesT], precision: MixedPrecision, rgb: Tensor, depth: Tensor
) -> Callable[[], None]:
    def step() -> None:
        features = precision.encode(network, rgb, depth)
        output = precision.compare(network, features, features.take(torch.arange(len(rgb), device=rgb.device).roll(1)))
        (output.logit.mean() + output.pose.mean()).backward()

    return step


def _seconds(step: Callable[[], None]) -> float:
    start = time.perf_counter()
    step()
    if torch.cuda.is_available():
        torch.cuda.synchronize()
    return time.perf_counter() - start
