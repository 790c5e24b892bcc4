"""Which nodes resemble an image without depth, such as an upload.

Owns a plain comparison of small, normalised colour images. The network needs depth and is not asked; an image with
depth is better ranked by `Localizer.nearest_nodes`.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.types import NodeId, Rgb

_BLOCK_PX = 6
"""Side in pixels of the squares that are averaged, so that a shift of a few pixels hardly matters."""


def most_similar_nodes(
    rgb: Rgb, keyframes: KeyframeStore, nodes: Sequence[NodeId], count: int
) -> tuple[tuple[NodeId, float], ...]:
    """Return the `count` nodes that resemble an image (72, 96, 3) most, best first, with a similarity in [-1, 1]."""
    if not nodes:
        return ()
    likeness = colour_descriptors(keyframes, nodes) @ _colour_descriptor(rgb)
    best = np.argsort(-likeness, kind="stable")[:count]
    return tuple((nodes[k], float(likeness[k])) for k in best)


def colour_descriptors(keyframes: KeyframeStore, nodes: Sequence[NodeId]) -> NDArray[np.float64]:
    """Return (N, S) unit vectors, one per node, whose products are the similarity in [-1, 1] of two images."""
    if not nodes:
        return np.empty((0, 0))
    return np.stack([_colour_descriptor(keyframes.observation(node).rgb) for node in nodes])


def _colour_descriptor(rgb: Rgb) -> NDArray[np.float64]:
    """Return a unit vector of the image's coarse colours, without its brightness and contrast."""
    rows, columns = rgb.shape[0] // _BLOCK_PX, rgb.shape[1] // _BLOCK_PX
    blocks = (
        rgb[: rows * _BLOCK_PX, : columns * _BLOCK_PX]
        .reshape(rows, _BLOCK_PX, columns, _BLOCK_PX, 3)
        .astype(np.float64)
    )
    coarse = blocks.mean(axis=(1, 3))
    centred = (coarse - coarse.mean(axis=(0, 1))).ravel()
    length = np.linalg.norm(centred)
    return centred / length if length > 0 else centred
