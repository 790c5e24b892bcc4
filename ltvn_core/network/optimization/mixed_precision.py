"""Mixed precision: layers in bfloat16 on request. `PairNetwork` always runs matching and geometry in float32."""

from dataclasses import dataclass

import torch
from torch import Tensor

from ltvn_core.network.base_network import BaseNetwork
from ltvn_core.network.device import device_of
from ltvn_core.network.image_features import FeaturesT, to_float32
from ltvn_core.network.pair_head import PairOutput


@dataclass(frozen=True, slots=True)
class MixedPrecision:
    """Runs a network in a given precision."""

    bfloat16: bool = False

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


FLOAT32 = MixedPrecision()
