"""LeRobot's depth in videos: 12 bits a pixel, finer near the camera than far away."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ltvn_core.errors import DriveError
from ltvn_core.types import Depth

LARGEST_CODE = 4095


@dataclass(frozen=True, slots=True, kw_only=True)
class DepthCodes:
    """What the codes 0 to 4095 mean. Code 0 also stands for everything nearer, and for no return."""

    depth_min: float = 0.01
    """Metres at code 0,"""
    depth_max: float = 10.0
    """and at the largest code."""
    shift: float = 3.5
    """Metres that are added before the logarithm."""
    use_log: bool = True
    """Steps grow with the distance; else they are equal."""

    def __post_init__(self) -> None:
        """Refuse a range that has no logarithm. Raises DriveError."""
        numbers = (self.depth_min, self.depth_max, self.shift)
        if not (all(map(math.isfinite, numbers)) and self.depth_max > self.depth_min > -self.shift):
            raise DriveError(
                f"Depth between {self.depth_min} and {self.depth_max} m, shifted by {self.shift}, is none."
            )

    def metres(self, codes: NDArray[np.uint16]) -> Depth:
        """Return depth in metres of codes (H, W), 0 for no return."""
        low, high = self._ends()
        value = low + codes.astype(np.float32) * ((high - low) / LARGEST_CODE)
        metres = np.exp(value) - self.shift if self.use_log else value
        return np.where((codes > 0) & (metres > 0), metres, 0).astype(np.float32)

    def codes(self, metres: Depth) -> NDArray[np.uint16]:
        """Return the codes of depth (H, W) in metres; what is farther than the largest code becomes no return."""
        low, high = self._ends()
        with np.errstate(divide="ignore", invalid="ignore"):
            value = np.log(metres + self.shift) if self.use_log else metres
        codes = np.rint((value - low) / (high - low) * LARGEST_CODE)
        return np.where((metres > 0) & (metres <= self.depth_max), codes.clip(1, LARGEST_CODE), 0).astype(np.uint16)

    def _ends(self) -> tuple[float, float]:
        if not self.use_log:
            return self.depth_min, self.depth_max
        return math.log(self.depth_min + self.shift), math.log(self.depth_max + self.shift)
