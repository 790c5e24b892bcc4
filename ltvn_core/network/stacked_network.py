"""The stacked network, for comparison: a residual network over both images, stacked along the channels.

Its feature rows are the images themselves, so every pair costs a full forward pass. It has neither token matches nor a
cheap score, and is trained with Eq. 1 alone.
"""

from itertools import pairwise
from typing import NamedTuple

import torch
from torch import Tensor, nn

from ltvn_core.network.architecture import NETWORK_CAMERA, StackedArchitecture
from ltvn_core.network.base_network import BaseNetwork
from ltvn_core.network.encoder import FARTHEST_DEPTH_M, ResidualBlock, conv_block
from ltvn_core.network.pair_head import PairOutput

_PIXELS = NETWORK_CAMERA.height * NETWORK_CAMERA.width


class StackedFeatures(NamedTuple):
    """B images without any encoding."""

    rgb: Tensor
    """(B, 3, H, W) in [0, 1]"""
    depth: Tensor
    """(B, H, W) metres; 0 where missing."""

    def take(self, rows: Tensor) -> "StackedFeatures":
        """Return the given images (N,)."""
        return StackedFeatures(self.rgb[rows], self.depth[rows])

    def channels(self) -> Tensor:
        """Return (B, 4, H, W): colour and depth, each about in [-1, 1]."""
        depth = self.depth.clamp(max=FARTHEST_DEPTH_M) * 0.4 - 1
        return torch.cat([self.rgb * 2 - 1, depth[:, None]], dim=1)


class StackedNetwork(BaseNetwork[StackedFeatures]):
    """Maps the 8 channels of source and target to the logit of reachability and the waypoint."""

    def __init__(self, size: StackedArchitecture | None = None) -> None:
        super().__init__()
        self._size = size = size or StackedArchitecture()
        widths = (size.stem, size.quarter, size.eighth, size.sixteenth, size.last)
        stages = [residual_stage(*each) for each in pairwise(widths)]
        self.trunk = nn.Sequential(conv_block(8, size.stem, stride=2, kernel=5), *stages)
        self.last = nn.Sequential(nn.Linear(size.last, size.hidden), nn.ReLU(), nn.Linear(size.hidden, 5))

    @property
    def size(self) -> StackedArchitecture:
        """Return the widths of the layers."""
        return self._size

    @property
    def row_length(self) -> int:
        """Return F, the numbers that are kept per image: its pixels."""
        return 4 * _PIXELS

    def encode(self, rgb: Tensor, depth: Tensor) -> StackedFeatures:
        """Keep rgb (B, 3, H, W) in [0, 1] and depth (B, H, W) in metres."""
        return StackedFeatures(rgb, depth)

    def unpack(self, rows: Tensor) -> StackedFeatures:
        """Return the images held in (B, F) rows, as float32."""
        rgb, depth = rows.float().split([3 * _PIXELS, _PIXELS], dim=1)
        shape = (NETWORK_CAMERA.height, NETWORK_CAMERA.width)
        return StackedFeatures(rgb.reshape(-1, 3, *shape), depth.reshape(-1, *shape))

    def compare(self, source: StackedFeatures, target: StackedFeatures) -> PairOutput:
        """Compare P sources with P targets."""
        pair = torch.cat([source.channels(), target.channels()], dim=1)
        features = self.trunk(pair.contiguous(memory_format=torch.channels_last)).mean(dim=(2, 3))
        numbers = self.last(features).float()
        return PairOutput(numbers[:, 0], numbers[:, 1:])

    def rough_logits(self, features: StackedFeatures) -> Tensor:
        """Return (B, B) zeros: there is no cheaper way than a full comparison."""
        return features.rgb.new_zeros(len(features.rgb), len(features.rgb))


def residual_stage(inputs: int, outputs: int) -> nn.Sequential:
    """Return the layers of one resolution: a halving, then two residual blocks."""
    return nn.Sequential(conv_block(inputs, outputs, stride=2), ResidualBlock(outputs), ResidualBlock(outputs))
