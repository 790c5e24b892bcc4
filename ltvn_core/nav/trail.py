"""What the robot saw on its way: the last few looks of a query, with the odometry of each.

Owns which looks are kept. Odometry drifts, so only the last metres say anything about where the robot is now.
"""

from collections import deque

import numpy as np

from ltvn_core.geometry import distance, relative
from ltvn_core.graph.closures import Stretch
from ltvn_core.types import Features, Pose

_KEPT = 24
"""Looks."""
_APART = 0.2
"""A look nearer than this d to the last one shows nothing new."""
_HERE = 0.2
"""A look nearer than this d to where the robot is now was taken here, not on the way."""


class Trail:
    """The looks of one query."""

    def __init__(self) -> None:
        """Begin without any."""
        self._looks: deque[tuple[Pose, Features]] = deque(maxlen=_KEPT)

    def saw(self, odometry: Pose, features: Features) -> None:
        """Remember a look (1, F) from an odometry pose (3,), unless it was taken where the last one was."""
        if not self._looks or distance(relative(self._looks[-1][0], odometry)) > _APART:
            self._looks.append((odometry.copy(), features))

    def forget(self) -> None:
        """Begin anew, where the way here seems to have been misunderstood."""
        self._looks.clear()

    def seen_from(self, odometry: Pose) -> Stretch | None:
        """Return the looks as they lie from an odometry pose (3,), without those taken there; None without any."""
        poses = relative(odometry, np.array([pose for pose, _ in self._looks]).reshape(-1, 3))
        elsewhere = np.flatnonzero(distance(poses) > _HERE)
        if not len(elsewhere):
            return None
        return Stretch(np.concatenate([self._looks[k][1] for k in elsewhere]), poses[elsewhere])
