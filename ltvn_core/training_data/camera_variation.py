"""Random variation of the camera's mounting and field of view between clusters of training images.

A network that was trained with a single mounting depends on its exact height and pitch, which no real robot keeps.
"""

from dataclasses import dataclass
from math import radians

import numpy as np

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.robots.robot_spec import LOCOBOT


@dataclass(frozen=True, slots=True)
class CameraVariation:
    """Ranges of the variation (all values are ours)."""

    share: float = 0.3
    """Share of the clusters with a camera other than the nominal one."""
    height_m: float = 0.08
    """Its height differs by up to this from the nominal one,"""
    pitch_rad: float = radians(4)
    """its pitch by up to this,"""
    fov: float = 0.05
    """and its field of view by up to this share."""

    def draw(self, rng: np.random.Generator, count: int) -> list[CameraModel]:
        """Return a camera for each of `count` clusters."""
        nominal = LOCOBOT.camera
        off = rng.uniform(-1, 1, (count, 3)) * (rng.random((count, 1)) < self.share)
        return [
            CameraModel.from_fov(
                nominal.width,
                nominal.height,
                nominal.horizontal_fov_rad * (1 + self.fov * fov),
                height_m=nominal.height_m + self.height_m * height,
                pitch_rad=self.pitch_rad * pitch,
            )
            for height, pitch, fov in off.tolist()
        ]
