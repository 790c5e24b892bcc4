"""Which nodes to offer as goals: places far from each other. The pictures themselves are in `thumbnails`."""

import numpy as np
from numpy.typing import NDArray

from ltvn_core.types import Pose

RADIAN_IN_M = 0.5
"""A turn by a radian makes two views as different as this many metres."""


def farthest_points(poses: Pose, count: int) -> NDArray[np.int64]:
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
