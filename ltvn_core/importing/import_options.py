"""What a person can ask of an import. Does nothing."""

import math
from dataclasses import dataclass

from ltvn_core.errors import OptionError
from ltvn_core.importing.drive_odometry import OdometrySource

EVERY_M, EVERY_DEG = 0.1, 8.0
"""Metres and degrees after which an image is kept, unless somebody says others."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportOptions:
    """How raw frames become a recording. Raises OptionError for a number that cannot be."""

    odometry: OdometrySource = OdometrySource.AUTO
    every_m: float = EVERY_M
    """An image is kept after so many metres,"""
    every_deg: float = EVERY_DEG
    """or degrees of heading or tilt; 0 and 0 keep all."""
    fov_deg: float | None = None
    """Horizontal field of view of a camera of which nothing else is known."""
    height_m: float | None = None
    """Height of the camera above the floor, where the source does not say."""
    pitch_deg: float | None = None
    """Tilt of a mounted camera, upwards positive."""
    scene: str = ""
    """What the recording calls the place; made from the source's name where it is empty."""

    def __post_init__(self) -> None:
        """Check the numbers."""
        if not (0 <= self.every_m < math.inf and 0 <= self.every_deg < math.inf):
            raise OptionError(f"--every-m and --every-deg are 0 or more, got {self.every_m} and {self.every_deg}.")
        if self.height_m is not None and not 0 <= self.height_m < 100:
            raise OptionError(f"--height is metres above the floor, got {self.height_m}.")
        if self.pitch_deg is not None and not abs(self.pitch_deg) < 90:
            raise OptionError(f"--pitch is degrees from level, between -90 and 90, got {self.pitch_deg}.")

    @property
    def has_own_spacing(self) -> bool:
        """Whether somebody said after how many metres or degrees to keep an image."""
        return (self.every_m, self.every_deg) != (EVERY_M, EVERY_DEG)
