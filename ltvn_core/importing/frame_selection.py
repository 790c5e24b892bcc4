"""Which images of a drive are kept: one whenever the robot has moved on, by its odometry or by what it sees.

A map needs images that differ. Owns the two measures of having moved, and no images but the last one kept.
"""

from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from ltvn_core.geometry import wrap_angle
from ltvn_core.types import Pose, Rgb, Tilt

MOVED_SHARE = 0.04
"""An image is kept when half of what is followed moved by this share of the image's width,"""
LOST_SHARE = 0.5
"""or when more than this share of it is no longer to be found."""

_WIDTH_PX = 160
_POINTS = 120
_FEWEST_POINTS = 8
_ROUNDING = 1e-4
"""Metres and radians that a source's poses may be rounded by: images 0.1 m apart are kept at 0.1 m."""
_NOISE = 2.0
"""Images that differ by less, in grey levels of 255 on average, show the same."""


class FrameSelection(Protocol):
    """Says of each image in turn whether to keep it; it is kept then."""

    def may_keep(self, pose: Pose, tilt: Tilt | None) -> bool:
        """Tell whether an image that was taken there could be kept, before anybody decodes it."""
        ...

    def keeps(self, rgb: Rgb, pose: Pose, tilt: Tilt | None) -> bool:
        """Tell whether the camera moved enough since the last image that was kept."""
        ...


class MotionSelection:
    """Keeps an image after so many metres or radians, of heading, pitch or roll."""

    def __init__(self, every_m: float, every_rad: float) -> None:
        """Keep everything where both are 0."""
        self._every_m, self._every_rad = every_m, every_rad
        self._last: NDArray[np.float64] | None = None

    def may_keep(self, pose: Pose, tilt: Tilt | None) -> bool:
        """Tell whether the robot drove or turned enough; see `FrameSelection`."""
        if self._last is None:
            return True
        gap = _pose_and_tilt(pose, tilt) - self._last
        moved_m, turned_rad = np.hypot(*gap[:2]), np.abs(wrap_angle(gap[2:])).max()
        # What is no number has not stood still: it is kept here, and refused with its reason where it is checked.
        return not (moved_m < self._every_m - _ROUNDING and turned_rad < self._every_rad - _ROUNDING)

    def keeps(self, rgb: Rgb, pose: Pose, tilt: Tilt | None) -> bool:
        """Tell whether the robot drove or turned enough; see `FrameSelection`."""
        if not self.may_keep(pose, tilt):
            return False
        self._last = _pose_and_tilt(pose, tilt)
        return True


class PictureSelection:
    """Keeps an image when the picture has moved on; for drives without any odometry."""

    def __init__(self) -> None:
        """Nothing was seen yet."""
        self._last: NDArray[np.uint8] | None = None

    def may_keep(self, pose: Pose, tilt: Tilt | None) -> bool:
        """Want every image, for the picture alone says whether it differs."""
        return True

    def keeps(self, rgb: Rgb, pose: Pose, tilt: Tilt | None) -> bool:
        """Tell whether the picture differs enough; see `FrameSelection`."""
        height = max(round(_WIDTH_PX * rgb.shape[0] / rgb.shape[1]), 1)
        small = cv2.resize(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), (_WIDTH_PX, height), interpolation=cv2.INTER_AREA)
        grey = np.asarray(small, np.uint8)
        if self._last is not None and self._last.shape == grey.shape and not _has_moved(self._last, grey):
            return False
        self._last = grey
        return True


def _pose_and_tilt(pose: Pose, tilt: Tilt | None) -> NDArray[np.float64]:
    return np.array([*pose, *(tilt or (0.0, 0.0))])


def _has_moved(before: NDArray[np.uint8], now: NDArray[np.uint8]) -> bool:
    if float(cv2.absdiff(before, now).mean()) < _NOISE:
        return False
    points = cv2.goodFeaturesToTrack(before, _POINTS, 0.01, 5)
    if points is None or len(points) < _FEWEST_POINTS:
        return True
    found, status, _ = cv2.calcOpticalFlowPyrLK(before, now, points, None)  # type: ignore[call-overload]
    followed = status.ravel() == 1
    if followed.mean() < 1 - LOST_SHARE:
        return True
    moved_px = np.linalg.norm((found - points)[followed].reshape(-1, 2), axis=1)
    return float(np.median(moved_px)) >= MOVED_SHARE * _WIDTH_PX
