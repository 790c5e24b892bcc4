"""Whose eyes look: a share of the clusters is seen by a camera mounted a little otherwise than the nominal one.

Owns how far cameras vary. A network that has seen only one mounting trusts it to the millimetre, and no real robot
keeps to it.
"""

from dataclasses import dataclass
from math import radians

import numpy as np

from ltvn_core.types import Intrinsics


@dataclass(frozen=True, slots=True)
class CameraVariation:
    """How camera mountings vary between clusters (all ours)."""

    share: float = 0.3
    """Share of the clusters that a camera other than the nominal one sees."""
    height_m: float = 0.08
    """Its height differs by up to this,"""
    pitch_rad: float = radians(4)
    """it is tilted by up to this,"""
    fov: float = 0.05
    """and its field of view differs by up to this share."""

    def draw(self, rng: np.random.Generator, count: int) -> list[Intrinsics]:
        """Return a camera for each of `count` clusters."""
        nominal = Intrinsics()
        off = rng.uniform(-1, 1, (count, 3)) * (rng.random((count, 1)) < self.share)
        return [
            nominal._replace(
                height_m=nominal.height_m + self.height_m * height,
                pitch_rad=self.pitch_rad * pitch,
                horizontal_fov_rad=nominal.horizontal_fov_rad * (1 + self.fov * fov),
            )
            for height, pitch, fov in off.tolist()
        ]
