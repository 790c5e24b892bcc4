"""The memory of pairs that were compared, because the method asks about many of them again and again.

Owns what is kept and for how long. Safe for several threads.
"""

from collections import OrderedDict
from threading import Lock
from typing import NamedTuple

import numpy as np

from ltvn_core.geometry import invert
from ltvn_core.types import Waypoint

MAX_PAIRS = 50_000
"""About 20 MB."""


class SurePose(NamedTuple):
    """Where the second image is, seen from the first, and how sure that is."""

    certainty: float
    """In [0, 1]."""
    waypoint: Waypoint
    """(3,)"""
    moved_m: float
    """How far the camera moved, up and down too."""
    turned_rad: float
    """How far it turned, tilting and rolling too."""

    def inverse(self) -> "SurePose":
        """Return the pose of the first image, seen from the second."""
        return self._replace(waypoint=invert(self.waypoint))

    def scaled(self, factor: float) -> "SurePose":
        """Return the pose so many times as far away, with the same turn."""
        return self._replace(waypoint=self.waypoint * [factor, factor, 1.0], moved_m=self.moved_m * factor)


NO_POSE = SurePose(0.0, np.zeros(3), 0.0, 0.0)
"""Nothing speaks for any pose."""


class PairMemory:
    """Remembers the last pairs by the hashes of both images."""

    def __init__(self) -> None:
        self._poses: OrderedDict[bytes, SurePose] = OrderedDict()
        self._lock = Lock()

    def recall(self, first: bytes, second: bytes) -> SurePose | None:
        """Return what was found for a pair; None if it was not compared, or long ago."""
        with self._lock:
            return self._poses.get(first + second)

    def keep(self, first: bytes, second: bytes, pose: SurePose) -> None:
        """Remember a pair, and forget the oldest where there are too many."""
        with self._lock:
            self._poses[first + second] = pose
            if len(self._poses) > MAX_PAIRS:
                self._poses.popitem(last=False)
