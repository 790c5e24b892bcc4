"""Hard negatives: pairs of images from different clusters that a network easily mistakes for neighbours.

Four kinds: pairs close by (many behind walls or round corners), perceptual aliases, opposite views of one place, and
random pairs. Only chooses the pairs; some are reachable after all, which the labels decide. The field `strangers` of
`DatasetRecipe` counts them: it keeps its old name, because recipes are stored in datasets.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ltvn_core.geometry import wrap_angle
from ltvn_core.types import Pose

NEAR_M = 3.0
"""Images closer than this are neighbours, even with a wall between them."""

BEHIND_M = 1.0
"""Images closer than this with opposite headings are opposite views of one place."""

OPPOSITE_RAD = np.radians(120)
"""Smallest difference of opposite headings."""

_ALIAS_CANDIDATES = 5
"""A perceptual alias is drawn from this many of the most similar far images."""

_CELL_PX = 12
"""Side in pixels of the squares whose mean colour and central depth form the descriptor of an image."""

PairRows = tuple[NDArray[np.int32], NDArray[np.int32]]
"""Sources and targets (P,), rows of the images."""


def hard_negative_pairs(
    rng: np.random.Generator,
    poses: Pose,
    group: NDArray[np.integer],
    rgb: NDArray[np.uint8],
    depth_mm: NDArray[np.uint16],
    count: int,
) -> PairRows:
    """Draw about `count` ordered pairs of images from different clusters, a quarter of each kind.

    Args:
        rng: Draws the pairs.
        poses: (N, 3) poses of the images.
        group: (N,) cluster of each image.
        rgb: (N, H, W, 3) colours.
        depth_mm: (N, H, W) depth in millimetres.
        count: Number of pairs; fewer are returned where duplicates are drawn.
    """
    if count == 0 or group.max() == group.min():
        return np.empty(0, np.int32), np.empty(0, np.int32)
    share = count // 4
    kinds = [
        _close_pairs_across_clusters(rng, poses, group, share),
        _perceptual_aliases(rng, poses, group, appearance_descriptors(rgb, depth_mm), share),
        _opposite_views(rng, poses, group, share),
    ]
    kinds.append(_random_pairs(rng, group, count - sum(len(kind) for kind in kinds)))
    pairs = np.unique(np.concatenate(kinds), axis=0)
    return pairs[:, 0].astype(np.int32), pairs[:, 1].astype(np.int32)


def appearance_descriptors(rgb: NDArray[np.uint8], depth_mm: NDArray[np.uint16]) -> NDArray[np.float32]:
    """Return descriptors (N, F): coarse colours and inverse depths of images (N, H, W, 3) and (N, H, W)."""
    count, height, width = depth_mm.shape
    rows, columns = height // _CELL_PX, width // _CELL_PX
    cells = rgb[:, : rows * _CELL_PX, : columns * _CELL_PX].reshape(count, rows, _CELL_PX, columns, _CELL_PX, 3)
    colours = cells.mean((2, 4), dtype=np.float32).reshape(count, -1) / 255
    middle = depth_mm[:, _CELL_PX // 2 :: _CELL_PX, _CELL_PX // 2 :: _CELL_PX].reshape(count, -1)
    nearness = 1 / np.maximum(middle.astype(np.float32) / 1000, 0.4)
    return np.concatenate([colours, nearness], axis=1, dtype=np.float32)


def _close_pairs_across_clusters(
    rng: np.random.Generator, poses: Pose, group: NDArray[np.integer], count: int
) -> NDArray[np.intp]:
    """Return at most `count` pairs (.., 2) of images closer than `NEAR_M`, many behind walls and round corners."""
    pairs = _pairs_within(poses, NEAR_M)
    return _sample(rng, pairs[group[pairs[:, 0]] != group[pairs[:, 1]]], count)


def _opposite_views(rng: np.random.Generator, poses: Pose, group: NDArray[np.integer], count: int) -> NDArray[np.intp]:
    pairs = _pairs_within(poses, BEHIND_M)
    turn = np.abs(wrap_angle(poses[pairs[:, 0], 2] - poses[pairs[:, 1], 2]))
    return _sample(rng, pairs[(group[pairs[:, 0]] != group[pairs[:, 1]]) & (turn > OPPOSITE_RAD)], count)


def _perceptual_aliases(
    rng: np.random.Generator, poses: Pose, group: NDArray[np.integer], descriptors: NDArray[np.float32], count: int
) -> NDArray[np.intp]:
    """Return pairs (count, 2) of similar images that are far apart or have opposite headings."""
    sources = rng.choice(len(poses), count, replace=count > len(poses))
    squares = (descriptors**2).sum(1)
    # Squared distances by the binomial formula: one matrix product instead of N x N differences.
    apart = squares[sources, None] + squares - 2 * descriptors[sources] @ descriptors.T
    shift = poses[sources, None, :2] - poses[None, :, :2]
    far = np.hypot(shift[..., 0], shift[..., 1]) > NEAR_M
    far |= np.abs(wrap_angle(poses[sources, None, 2] - poses[None, :, 2])) > OPPOSITE_RAD
    apart[~far | (group[sources, None] == group)] = np.inf
    best = np.argpartition(apart, min(_ALIAS_CANDIDATES, len(poses) - 1), axis=1)[:, :_ALIAS_CANDIDATES]
    targets = best[np.arange(count), rng.integers(best.shape[1], size=count)]
    found = np.isfinite(apart[np.arange(count), targets])
    return np.column_stack([sources, targets])[found]


def _random_pairs(rng: np.random.Generator, group: NDArray[np.integer], count: int) -> NDArray[np.intp]:
    # Twice as many as needed, because some lie within one cluster.
    pairs = rng.integers(len(group), size=(2 * count, 2))
    return pairs[group[pairs[:, 0]] != group[pairs[:, 1]]][:count]


def _pairs_within(poses: Pose, radius_m: float) -> NDArray[np.intp]:
    """Return all ordered pairs (P, 2) of images closer than a radius."""
    pairs = KDTree(poses[:, :2]).query_pairs(radius_m, output_type="ndarray")
    return np.concatenate([pairs, pairs[:, ::-1]])


def _sample(rng: np.random.Generator, pairs: NDArray[np.intp], count: int) -> NDArray[np.intp]:
    return pairs[rng.choice(len(pairs), min(count, len(pairs)), replace=False)]
