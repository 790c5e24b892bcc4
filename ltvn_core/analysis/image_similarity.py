"""Which nodes resemble an image without depth, such as an upload.

Owns a plain comparison of small, normalised colour images. The network is not used, because it needs depth; images with
depth are ranked better by `graph.localiser.nearest_nodes`.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.types import NodeId, Rgb

_GRID = (12, 16)
"""Rows and columns of blocks that are averaged, each 6 pixels of the network's camera wide, so that small shifts hardly
matter."""


LIKELY_HELD = 0.7
"""Similarity above which a map probably shows the place of an image. Of 6,000 pictures of other apartments, 1 in 20
reaches it with the best of 400 nodes (six apartments, ours)."""


def most_similar_nodes(
    rgb: Rgb, keyframes: KeyframeStore, nodes: Sequence[NodeId], count: int
) -> tuple[tuple[NodeId, float], ...]:
    """Return the `count` nodes that resemble an image most, best first, with a similarity in [-1, 1].

    The image (H, W, 3) has at least 12 x 16 pixels; its size need not be that of the nodes' images.
    """
    if not nodes:
        return ()
    descriptors = colour_descriptors(keyframes, nodes)
    own = _colour_descriptor(rgb)
    # An image of one colour has no structure left, so it is equally similar to any other of one colour.
    likeness: NDArray[np.float64] = np.where(descriptors.any(axis=1), 0.0, 1.0)
    if own.any():
        likeness = np.asarray(descriptors @ own)
    best = np.argsort(-likeness, kind="stable")[:count]
    return tuple((nodes[k], float(likeness[k])) for k in best)


def colour_descriptors(keyframes: KeyframeStore, nodes: Sequence[NodeId]) -> NDArray[np.float64]:
    """Return (N, S) unit vectors, one per node, whose products are the similarity in [-1, 1] of two images."""
    if not nodes:
        return np.empty((0, 0))
    return np.stack([_colour_descriptor(keyframes.observation(node).rgb) for node in nodes])


def _colour_descriptor(rgb: Rgb) -> NDArray[np.float64]:
    """Return a unit vector of the image's coarse colours, without its brightness and contrast."""
    rows, columns = _GRID
    high = rgb.shape[0] // rows
    wide = rgb.shape[1] // columns
    blocks = rgb[: rows * high, : columns * wide].reshape(rows, high, columns, wide, 3).astype(np.float64)
    coarse = blocks.mean(axis=(1, 3))
    centred = (coarse - coarse.mean(axis=(0, 1))).ravel()
    length = np.linalg.norm(centred)
    return centred / length if length > 0 else centred
