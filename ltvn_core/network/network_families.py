"""The network families: pair, stacked, ensemble and contrastive network, and their registry.

A new family needs a description in `architecture`, a subclass of `BaseNetwork`, and one line in `_FAMILIES`.

The pair network is the default. The stacked network is for comparison: a residual network over both images, stacked
along the channels. Its feature rows are the images themselves, so every pair costs a full forward pass. It is trained
with Eq. 1 alone. Ensemble and contrastive networks add output layers to a trained pair network and leave its weights
frozen, so their files are small and the pose estimates stay the same.
"""

from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from itertools import pairwise
from typing import Any, NamedTuple, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from ltvn_core.errors import WeightsError
from ltvn_core.network.architecture import (
    NETWORK_CAMERA,
    AnyArchitecture,
    ContrastiveArchitecture,
    EnsembleArchitecture,
    PairArchitecture,
    StackedArchitecture,
)
from ltvn_core.network.base_network import AnyNetwork, BaseNetwork, ComparedBatch
from ltvn_core.network.device import to_tensor
from ltvn_core.network.encoder import FARTHEST_DEPTH_M, Encoder, ResidualBlock, conv_block
from ltvn_core.network.image_features import (
    ImageFeatures,
    coarse_descriptors,
    place_columns,
    row_length,
    similarity,
    unpack,
)
from ltvn_core.network.loss import contrastive_loss, matching_loss, place_loss, true_correspondence
from ltvn_core.network.pair_head import PairHead, PairOutput, summary_length
from ltvn_core.types import Features


class PairNetwork(BaseNetwork[ImageFeatures]):
    """Encodes each image into tokens with 3D points, matches the tokens of two images and aligns the matches."""

    is_traceable = True

    def __init__(self, size: PairArchitecture | None = None) -> None:
        super().__init__()
        size = size or PairArchitecture()
        self.encoder = Encoder(size)
        self.head = PairHead(size)
        self.place_line = nn.Parameter(torch.tensor([8.0, -4.0]))

    @property
    def size(self) -> PairArchitecture:
        """Return the widths of the layers."""
        return self.encoder.size

    @property
    def row_length(self) -> int:
        """Return F, the numbers that are kept per image."""
        return row_length(self.size)

    def encode(self, rgb: Tensor, depth: Tensor) -> ImageFeatures:
        """Encode rgb (B, 3, H, W) in [0, 1] and depth (B, H, W) in metres."""
        return self.encoder(rgb, depth)

    def unpack(self, rows: Tensor) -> ImageFeatures:
        """Return the features stored in (B, F) rows, as float32."""
        return unpack(rows, self.size)

    def compare(self, source: ImageFeatures, target: ImageFeatures) -> PairOutput:
        """Compare P sources with P targets, in float32 whatever precision is set: matching and geometry need it."""
        with torch.autocast(source.points.device.type, enabled=False):
            return self.head(source, target)

    def place_logits(self, query: Tensor, key: Tensor) -> Tensor:
        """Return (S, T) rough logits of reachability from place queries (S, P) and keys (T, P)."""
        return self.place_line[0] * (query @ key.T) + self.place_line[1]

    def rough_logits(self, features: ImageFeatures) -> Tensor:
        """Return (B, B) place scores."""
        return self.place_logits(features.place_query, features.place_key)

    def place_keys(self, features: Features) -> NDArray[np.float32]:
        """Return the place keys (N, P) of images (N, F)."""
        return features[:, place_columns(self.size)[1]].astype(np.float32)

    def place_scores(self, source: Tensor, keys: Tensor) -> Tensor:
        """Return the place logits (N,) of one source row (1, F) with place keys (N, P)."""
        return self.place_logits(source[:, place_columns(self.size)[0]].float(), keys)[0]

    def likeness(self, source: Tensor, features: Features | Tensor, rows: NDArray[np.intp]) -> Tensor:
        """Return the similarity (N,) of a source row (1, F) with rows (N,) of features (M, F), from some tokens."""
        targets = to_tensor(coarse_descriptors(features, rows, self.size), source.device).float()
        return similarity(self.unpack(source), targets, self.head.sharpness)

    def auxiliary_losses(self, compared: ComparedBatch[ImageFeatures]) -> dict[str, Tensor]:
        """Return the losses on token matches and on the place score."""
        losses = {"place": place_loss(self.rough_logits(compared.features), compared.labels)}
        if compared.output.matching is not None:
            true = true_correspondence(
                compared.source_features, compared.target_features, compared.waypoints, compared.same_scene
            )
            losses["matching"] = matching_loss(compared.output.matching, true)
        return losses


_PIXELS = NETWORK_CAMERA.height * NETWORK_CAMERA.width


class StackedFeatures(NamedTuple):
    """B images, not encoded."""

    rgb: Tensor
    """(B, 3, H, W) in [0, 1]."""
    depth: Tensor
    """(B, H, W) metres; 0 where missing."""

    def take(self, rows: Tensor) -> "StackedFeatures":
        """Return the given images (N,)."""
        return StackedFeatures(self.rgb[rows], self.depth[rows])

    def channels(self) -> Tensor:
        """Return (B, 4, H, W): colour and depth, each roughly in [-1, 1]."""
        depth = self.depth.clamp(max=FARTHEST_DEPTH_M) * 0.4 - 1
        return torch.cat([self.rgb * 2 - 1, depth[:, None]], dim=1)


class StackedNetwork(BaseNetwork[StackedFeatures]):
    """Maps the 8 channels of source and target to the logit of reachability and the waypoint."""

    def __init__(self, size: StackedArchitecture | None = None) -> None:
        super().__init__()
        self._size = size = size or StackedArchitecture()
        widths = (size.stem, size.quarter, size.eighth, size.sixteenth, size.last)
        stages = [
            nn.Sequential(conv_block(inputs, outputs, stride=2), ResidualBlock(outputs), ResidualBlock(outputs))
            for inputs, outputs in pairwise(widths)
        ]
        self.trunk = nn.Sequential(conv_block(8, size.stem, stride=2, kernel=5), *stages)
        self.last = nn.Sequential(nn.Linear(size.last, size.hidden), nn.ReLU(), nn.Linear(size.hidden, 5))

    @property
    def size(self) -> StackedArchitecture:
        """Return the widths of the layers."""
        return self._size

    @property
    def row_length(self) -> int:
        """Return F, the length of an image's feature row: its pixel values."""
        return 4 * _PIXELS

    def encode(self, rgb: Tensor, depth: Tensor) -> StackedFeatures:
        """Return rgb (B, 3, H, W) in [0, 1] and depth (B, H, W) in metres unchanged."""
        return StackedFeatures(rgb, depth)

    def unpack(self, rows: Tensor) -> StackedFeatures:
        """Return the images stored in (B, F) rows, as float32."""
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
        """Return (B, B) zeros, because this family has no cheap score."""
        return features.rgb.new_zeros(len(features.rgb), len(features.rgb))


NEGATIVES = 50
"""Number of unreachable pairs that each reachable pair is contrasted with; HTM's value."""


class EnsembleNetwork(PairNetwork):
    """Ensemble of output layers: each member learns from a share of the pairs, and the lowest logit decides."""

    def __init__(self, size: EnsembleArchitecture | None = None) -> None:
        size = size or EnsembleArchitecture()
        super().__init__(size)
        self.requires_grad_(False)
        numbers, wide, narrow = summary_length(size), size.member_hidden, size.member_hidden // 2
        self.members = nn.ModuleList(
            nn.Sequential(nn.Linear(numbers, wide), nn.ReLU(), nn.Linear(wide, narrow), nn.ReLU(), nn.Linear(narrow, 1))
            for _ in range(size.members)
        )

    def train(self, mode: bool = True) -> Self:
        """Set the training mode of the added layers; batch normalisation below them keeps its statistics."""
        super().train(mode)
        self.encoder.eval()
        self.head.eval()
        return self

    def compare(self, source: ImageFeatures, target: ImageFeatures) -> PairOutput:
        """Compare P sources with P targets, in float32 whatever precision is set: matching and geometry need it."""
        with torch.autocast(source.points.device.type, enabled=False):
            summary = self.head.summarise(source, target)
            logits = torch.cat([member(summary.numbers) for member in self.members], dim=1)
            pairs = torch.arange(len(logits), device=logits.device)
            # While training, each pair is learned by one member.
            judged = logits[pairs, pairs % logits.shape[1]] if self.training else logits.min(dim=1).values
            return PairOutput(judged, self.head.conclude(summary).pose)

    def auxiliary_losses(self, compared: ComparedBatch[ImageFeatures]) -> dict[str, Tensor]:
        """Return no terms, because the layers that they train are frozen."""
        return {}


class ContrastiveNetwork(EnsembleNetwork):
    """A single score trained to distinguish a reachable pair from many others (contrastive predictive coding)."""

    def __init__(self, size: ContrastiveArchitecture | None = None) -> None:
        super().__init__(size or ContrastiveArchitecture())

    def reachability_loss(self, logit: Tensor, reachable: Tensor) -> Tensor:
        """Return InfoNCE for P pairs, (P,)."""
        return contrastive_loss(logit, reachable, negatives=NEGATIVES)


_FAMILIES: Mapping[type[AnyArchitecture], Callable[[Any], AnyNetwork]] = {
    PairArchitecture: PairNetwork,
    StackedArchitecture: StackedNetwork,
    EnsembleArchitecture: EnsembleNetwork,
    ContrastiveArchitecture: ContrastiveNetwork,
}
_ARCHITECTURES: dict[str, type[AnyArchitecture]] = {each().name: each for each in _FAMILIES}

_MAX_WIDTH = 65_536
"""Largest accepted layer width; a description with a wider layer is damaged."""

NETWORK_FAMILIES = tuple(_ARCHITECTURES)
"""The names of all families."""


def build_network(size: AnyArchitecture) -> AnyNetwork:
    """Return a new network with random weights from torch's generator."""
    return _FAMILIES[type(size)](size)


def extend_network(below: AnyNetwork, size: EnsembleArchitecture, seed: int) -> AnyNetwork:
    """Return a trained network with new layers on top, whose random weights are seeded with `seed`."""
    torch.manual_seed(seed)
    same = {each.name: getattr(below.size, each.name) for each in fields(below.size) if each.name != "name"}
    network = build_network(replace(size, **same))
    network.load_state_dict(below.state_dict(), strict=False)
    return network


def default_architecture(family: str) -> AnyArchitecture:
    """Return the default sizes of a family. Raises WeightsError for an unknown family."""
    if family not in _ARCHITECTURES:
        raise WeightsError(f"made for the architecture {family!r}; this version has {', '.join(NETWORK_FAMILIES)}.")
    return _ARCHITECTURES[family]()


def read_architecture(description: Mapping[str, Any]) -> AnyArchitecture:
    """Return the sizes written as a mapping. Raises WeightsError if the family is unknown or a size is missing."""
    kind = type(default_architecture(str(description.get("name"))))
    try:
        sizes: dict[str, Any] = {each.name: int(description[each.name]) for each in fields(kind) if each.name != "name"}
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise WeightsError(f"the description of the architecture is damaged ({error}).") from error
    if wrong := {name: size for name, size in sizes.items() if not 0 < size <= _MAX_WIDTH}:
        raise WeightsError(f"the architecture has impossible sizes: {wrong!s:.100}; each is 1 to {_MAX_WIDTH:,}.")
    return kind(**sizes)
