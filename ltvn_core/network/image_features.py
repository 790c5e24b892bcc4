"""The features of images, and their conversion to one row of numbers per image and back.

The prefilter is a cheap score of one source with many targets, from a few of their tokens: it estimates how much of the
source appears in a target, without geometry.
"""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple, Protocol, Self, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ltvn_core.network.architecture import PairArchitecture
from ltvn_core.types import Features


class EncodedImages(Protocol):
    """The features of B images of any network: a named tuple of tensors whose first axis is the image."""

    def __iter__(self) -> Iterator[Tensor]:
        """Yield the tensors in the order in which a row holds them."""
        ...

    @classmethod
    def _make(cls, iterable: Sequence[Tensor]) -> Self: ...

    def take(self, rows: Tensor) -> Self:
        """Return the features of the given images (N,)."""
        ...


FeaturesT = TypeVar("FeaturesT", bound=EncodedImages)


class ImageFeatures(NamedTuple):
    """Features of B images with T tokens each; points are x forward, y left, z up of the camera, metres."""

    descriptors: Tensor
    """(B, T, D) unit vectors, matched between images."""
    unmatched: Tensor
    """(B, T) logit that a token has no match."""
    saliency: Tensor
    """(B, T) logit of the weight of a token's match."""
    values: Tensor
    """(B, T, V) value vector that a token passes to its match."""
    points: Tensor
    """(B, T, 3) surface point of the token; all zero where depth is missing."""
    depth: Tensor
    """(B, G) metres on a coarse grid; 0 where depth is missing."""
    place_query: Tensor
    """(B, P) unit vector of the image as source of an edge."""
    place_key: Tensor
    """(B, P) unit vector of the image as target of an edge."""

    def take(self, rows: Tensor) -> "ImageFeatures":
        """Return the features of the given images (N,)."""
        return self._make([part[rows] for part in self])


def pack(features: EncodedImages) -> Tensor:
    """Return (B, F) half-precision rows."""
    return torch.cat([part.flatten(1).half() for part in features], dim=1)


def to_float32(features: FeaturesT) -> FeaturesT:
    """Return the features in single precision."""
    return features._make([part.float() for part in features])


def join(parts: Sequence[FeaturesT]) -> FeaturesT:
    """Return the features of all images of several parts, at least one."""
    return parts[0]._make([torch.cat(column) for column in zip(*parts, strict=True)])


def unpack(rows: Tensor, architecture: PairArchitecture) -> ImageFeatures:
    """Return the features stored in (B, F) rows, as float32."""
    parts = torch.split(rows.float(), _lengths(architecture), dim=1)
    return ImageFeatures._make(
        [part.unflatten(1, shape) for part, shape in zip(parts, _shapes(architecture), strict=True)]
    )


def row_length(architecture: PairArchitecture) -> int:
    """Return F, the length of an image's feature row."""
    return sum(_lengths(architecture))


def place_columns(architecture: PairArchitecture) -> tuple[slice, slice]:
    """Return the columns of the place query and of the place key within a row."""
    end = row_length(architecture)
    width = architecture.place
    return slice(end - 2 * width, end - width), slice(end - width, end)


def _shapes(size: PairArchitecture) -> tuple[tuple[int, ...], ...]:
    tokens = size.token_count
    of_tokens = (tokens, size.descriptor), (tokens,), (tokens,), (tokens, size.value), (tokens, 3)
    return *of_tokens, (size.depth_count,), (size.place,), (size.place,)


def _lengths(architecture: PairArchitecture) -> list[int]:
    return [math.prod(shape) for shape in _shapes(architecture)]


SOURCE_TOKENS = 32
"""Number of source tokens that the prefilter matches: those least likely to have no match."""

TARGET_STEP = 2
"""Step between the target tokens that the prefilter matches, along rows and columns."""


SCREENING_CUT = 0.1
"""Least screening score of a pair that is compared in full. On drives through tune-0 and tune-office-0, 18 and 38 % of
all pairs reach it, and 100 and 99 % of the pairs with r > 0.6 and d < 1."""
_PLACE_SHARE = 0.03
"""Weight of the place logit in the screening score, which is the similarity plus the weighted place logit."""


def may_match(logits: Tensor, likeness: Tensor) -> Tensor:
    """Return which targets (N,) are worth a full comparison, by their rough logits and `similarity` (N,)."""
    return likeness + _PLACE_SHARE * logits >= SCREENING_CUT


def coarse_descriptors(
    features: Features | Tensor, rows: NDArray[np.intp], size: PairArchitecture
) -> Features | Tensor:
    """Return the descriptors (N, M, D) of a quarter of the tokens, for the given rows (N,) of features (H, F)."""
    descriptors = features[:, : size.token_count * size.descriptor]  # They come first in a row.
    grid = descriptors.reshape(len(features), *size.grid, size.descriptor)
    return grid[:, ::TARGET_STEP, ::TARGET_STEP][rows].reshape(len(rows), -1, size.descriptor)


def similarity(source: ImageFeatures, targets: Tensor, sharpness: Tensor) -> Tensor:
    """Return the share (N,) of the best tokens of one source that appear in targets (N, M, D)."""
    surest = source.unmatched[0].topk(min(SOURCE_TOKENS, source.unmatched.shape[1]), largest=False)
    likeness = targets.flatten(0, 1) @ source.descriptors[0, surest.indices].T
    # The maximum over a middle axis takes an eighth of the time.
    best = likeness.reshape(*targets.shape[:2], -1).amax(1).T.contiguous()
    return torch.sigmoid(sharpness * best - surest.values[:, None]).mean(0)
