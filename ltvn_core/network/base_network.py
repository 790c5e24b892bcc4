"""The base class of all networks: what training, mining, prediction and files need, and the calibration of r.

The networks are in `ltvn_core.network.network_families`. Optional parts (cheap scores, auxiliary losses) are absent by
default.
"""

from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, Generic, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from ltvn_core.network.architecture import AnyArchitecture
from ltvn_core.network.device import device_of
from ltvn_core.network.image_features import FeaturesT, to_float32
from ltvn_core.network.loss import cross_entropy
from ltvn_core.network.pair_head import PairOutput
from ltvn_core.types import Features


class ComparedBatch(NamedTuple, Generic[FeaturesT]):
    """B images of a training step and P pairs of them, with predictions and ground truth."""

    features: FeaturesT
    """Features of the B images."""
    source_features: FeaturesT
    """Features of the P sources."""
    target_features: FeaturesT
    """Features of the P targets."""
    output: PairOutput
    """Predictions of the network for the pairs."""
    waypoints: Tensor
    """(P, 3) true dx, dy, dtheta."""
    same_scene: Tensor
    """(P,) whether both images are of one scene."""
    labels: Tensor
    """(B, B): 1 reachable, 0 not, nan unknown."""


class BaseNetwork(nn.Module, Generic[FeaturesT]):
    """f(o_i, o_j) -> (r, dx, dy, dtheta), in an `encode` per image and a `compare` per pair."""

    is_traceable = False
    """Whether `compare` does the same operations for any pairs and any number of them, so that it can be traced."""
    calibration: Tensor
    """(2,) scale and offset of the logit, fitted on validation after training (Platt)."""

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("calibration", torch.tensor([1.0, 0.0]))

    @property
    @abstractmethod
    def size(self) -> AnyArchitecture:
        """Layer sizes, which are stored with the weights."""

    @property
    @abstractmethod
    def row_length(self) -> int:
        """Return F, the length of an image's feature row."""

    @abstractmethod
    def encode(self, rgb: Tensor, depth: Tensor) -> FeaturesT:
        """Encode rgb (B, 3, H, W) in [0, 1] and depth (B, H, W) in metres, 0 where missing."""

    @abstractmethod
    def unpack(self, rows: Tensor) -> FeaturesT:
        """Return the features stored in (B, F) rows, as float32."""

    @abstractmethod
    def compare(self, source: FeaturesT, target: FeaturesT) -> PairOutput:
        """Compare P sources with P targets."""

    @abstractmethod
    def rough_logits(self, features: FeaturesT) -> Tensor:
        """Return (B, B) cheap logits of reachability between all images; all 0 if the network has no cheap score."""

    def place_keys(self, features: Features) -> NDArray[np.float32] | None:
        """Return the keys (N, K) of images (N, F) for the cheapest score; None if the network has no cheap scores."""
        return None

    def place_scores(self, source: Tensor, keys: Tensor) -> Tensor:
        """Return rough logits (N,) of one source row (1, F) with images given by their keys (N, K)."""
        raise NotImplementedError

    def likeness(self, source: Tensor, features: Features | Tensor, rows: NDArray[np.intp]) -> Tensor:
        """Return a cheap similarity (N,) of one source row (1, F) with the given rows (N,) of features (M, F)."""
        raise NotImplementedError

    def auxiliary_losses(self, compared: ComparedBatch[FeaturesT]) -> dict[str, Tensor]:
        """Return the terms that training adds to Eq. 1, by the name of their weight in `Hyperparameters`."""
        return {}

    def reachability_loss(self, logit: Tensor, reachable: Tensor) -> Tensor:
        """Return L_r of Eq. 1 for P pairs, (P,), from their logits (P,) and labels (P,)."""
        return cross_entropy(logit, reachable)

    def reachability(self, logit: Tensor) -> Tensor:
        """Return the calibrated probability of logits of any shape."""
        return torch.sigmoid(self.calibration[0] * logit + self.calibration[1])


AnyNetwork = BaseNetwork[Any]
"""A network of any family."""


@dataclass(frozen=True, slots=True)
class MixedPrecision:
    """Runs a network with layers in bfloat16 on request; `PairNetwork` matches and aligns in float32 all the same."""

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
