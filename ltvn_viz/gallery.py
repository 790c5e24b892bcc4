"""Which nodes to offer as goals, and which look like a picture.

Pure functions over arrays; the pictures themselves are in `thumbnails`.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from ltvn_core.types import Pose, Rgb

RADIAN_IN_M = 0.5
"""A turn by a radian makes two views as different as this many metres."""


def spread(poses: Pose, count: int) -> NDArray[np.int64]:
    """Return up to `count` rows of poses (N, 3) that lie far from each other, farthest point first."""
    if not len(poses):
        return np.empty(0, np.int64)
    embedded = np.concatenate(
        [poses[:, :2], RADIAN_IN_M * np.stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])], axis=1)], axis=1
    )
    chosen = [int(np.argmin(np.linalg.norm(embedded - embedded.mean(axis=0), axis=1)))]
    gap = np.linalg.norm(embedded - embedded[chosen[0]], axis=1)
    while len(chosen) < min(count, len(poses)) and gap.max() > 0:
        chosen.append(int(np.argmax(gap)))
        gap = np.minimum(gap, np.linalg.norm(embedded - embedded[chosen[-1]], axis=1))
    return np.array(chosen)


def signature(rgb: Rgb) -> NDArray[np.float32]:
    """Return (F,) a tiny, brightness-free version of a picture (H, W, 3), of length 1."""
    tiny = cv2.resize(rgb, (24, 18), interpolation=cv2.INTER_AREA).astype(np.float32)
    tiny -= tiny.mean()
    return (tiny / max(float(np.linalg.norm(tiny)), 1e-6)).ravel()


def most_alike(picture: NDArray[np.float32], candidates: NDArray[np.float32], count: int) -> NDArray[np.int64]:
    """Return up to `count` rows of signatures (N, F), those most like the signature `picture` (F,) first."""
    return np.argsort(-(candidates @ picture), kind="stable")[:count]
