"""Which of many images may show the same place: one vector an image, then votes of the strongest key points.

Owns the quick comparison that spares the geometric predictor most of the full ones. Decides nothing about reachability.
The vector is a VLAD (H. Jegou et al., CVPR 2010) of RootSIFT descriptors.
"""

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

WORDS_FILE = Path(__file__).with_name("geometric_words.npz")
"""The visual words, which `tools/fit_geometric.py` fitted."""

VOTERS = 96
"""So many of an image's strongest key points vote."""

_VOTE_RATIO = 0.85


class VisualWords(NamedTuple):
    """Typical descriptors: W of them, in D dimensions."""

    mean: NDArray[np.float32]
    """(128,)"""
    axes: NDArray[np.float32]
    """(128, D)"""
    centres: NDArray[np.float32]
    """(W, D)"""


@lru_cache(maxsize=1)
def visual_words() -> VisualWords:
    """Return the words that come with the package."""
    with np.load(WORDS_FILE) as stored:
        return VisualWords(*(stored[name].astype(np.float32) for name in VisualWords._fields))


def place_vector(descriptors: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return what the descriptors (K, 128) of an image say together, a unit vector (W * D,); zeros where K is 0."""
    words = visual_words()
    if not len(descriptors):
        return np.zeros(words.centres.size, np.float32)
    reduced = (descriptors.astype(np.float32) - words.mean) @ words.axes
    nearest = (reduced @ words.centres.T - (words.centres**2).sum(1) / 2).argmax(1)
    sums = np.zeros_like(words.centres)
    np.add.at(sums, nearest, reduced - words.centres[nearest])
    # So that a word that occurs often, as on a tiled floor, counts no more than any other.
    sums /= np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-6)
    vector = sums.ravel()
    return (vector / np.maximum(np.linalg.norm(vector), 1e-6)).astype(np.float32)


def most_similar(vector: NDArray[np.float32], others: Sequence[NDArray[np.float32]], count: int) -> NDArray[np.intp]:
    """Return which of N vectors are most like one, the best first."""
    likeness = np.stack(others) @ vector
    return np.argsort(-likeness, kind="stable")[:count]


def votes(first: NDArray[np.uint8], second: NDArray[np.uint8]) -> int:
    """Return how many of the strongest descriptors (K, 128) of one image have a clear match among another's."""
    cosines = (first[:VOTERS].astype(np.float32) / 255**2) @ second[: 2 * VOTERS].astype(np.float32).T
    if cosines.shape[0] == 0 or cosines.shape[1] < 2:
        return 0
    top = np.partition(cosines, -2, axis=1)[:, -2:]
    return int(np.count_nonzero((1 - top[:, 1]) < _VOTE_RATIO**2 * (1 - top[:, 0])))
