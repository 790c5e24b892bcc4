"""The whole network: encoder, pair head, the cheap place score, and the calibration of reachability.

Owns how the parts are put together. Training, files and numpy are elsewhere.
"""

import torch
from torch import Tensor, nn

from ltvn_core.model.architecture import Architecture
from ltvn_core.model.encoder import Encoder
from ltvn_core.model.features import ImageFeatures
from ltvn_core.model.pair_head import PairHead, PairOutput


class PairNetwork(nn.Module):
    """f(o_i, o_j) -> (r, dx, dy, dtheta), in an `encode` per image and a `compare` per pair."""

    calibration: Tensor
    """(2,) scale and offset of the logit, fitted on validation after training (Platt)."""

    def __init__(self, size: Architecture | None = None) -> None:
        super().__init__()
        self.size = size or Architecture()
        self.encoder = Encoder(self.size)
        self.head = PairHead(self.size)
        self.place_line = nn.Parameter(torch.tensor([8.0, -4.0]))
        self.register_buffer("calibration", torch.tensor([1.0, 0.0]))

    def encode(self, rgb: Tensor, depth: Tensor) -> ImageFeatures:
        """Encode rgb (B, 3, H, W) in [0, 1] and depth (B, H, W) in metres."""
        return self.encoder(rgb, depth)

    def compare(self, source: ImageFeatures, target: ImageFeatures) -> PairOutput:
        """Compare P sources with P targets."""
        return self.head(source, target)

    def place_logits(self, query: Tensor, key: Tensor) -> Tensor:
        """Return (S, T) rough logits of reachability from place queries (S, P) and keys (T, P)."""
        return self.place_line[0] * (query @ key.T) + self.place_line[1]

    def reachability(self, logit: Tensor) -> Tensor:
        """Return the calibrated probability of logits of any shape."""
        return torch.sigmoid(self.calibration[0] * logit + self.calibration[1])
