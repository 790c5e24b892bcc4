"""The pair network: encoder, pair head and a cheap place score, combined."""

import torch
from torch import Tensor, nn

from ltvn_core.network.architecture import PairArchitecture
from ltvn_core.network.base_network import BaseNetwork, ComparedBatch
from ltvn_core.network.encoder import Encoder
from ltvn_core.network.image_features import ImageFeatures, place_columns, row_length, unpack
from ltvn_core.network.loss import matching_loss, place_loss, true_correspondence
from ltvn_core.network.pair_head import PairHead, PairOutput
from ltvn_core.network.prefilter import PrefilterScores, coarse_descriptors, similarity


class PairNetwork(BaseNetwork[ImageFeatures]):
    """Encodes each image into tokens in space, matches two images' tokens and aligns what matched."""

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
        """Return the features held in (B, F) rows, as float32."""
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

    def prefilter_scores(self, source: Tensor, targets: Tensor) -> PrefilterScores:
        """Return the place scores of one source row (1, F) with target rows (T, F), and match some of its tokens."""
        query, key = place_columns(self.size)
        logits = self.place_logits(source[:, query].float(), targets[:, key].float())[0]
        alike = similarity(self.unpack(source), coarse_descriptors(targets, self.size), self.head.sharpness)
        return PrefilterScores(logits, alike)

    def auxiliary_losses(self, compared: ComparedBatch[ImageFeatures]) -> dict[str, Tensor]:
        """Return the losses on token matches and on the place score."""
        losses = {"place": place_loss(self.rough_logits(compared.features), compared.labels)}
        if compared.output.matching is not None:
            true = true_correspondence(
                compared.source_features, compared.target_features, compared.waypoints, compared.same_scene
            )
            losses["matching"] = matching_loss(compared.output.matching, true)
        return losses
