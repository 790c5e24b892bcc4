"""Checks of images: types, shapes, units and limits of colour, depth, odometry, stamp and step.

Owns these rules and the messages about violations. Does not resize images; `ltvn_core.preprocessing` does.
"""

import operator
from typing import SupportsFloat, SupportsIndex

import numpy as np
from numpy.typing import ArrayLike

from ltvn_core.cameras.camera_model import MILLIMETRES
from ltvn_core.errors import ImageError
from ltvn_core.types import Depth, FrameId, Observation, OriginalImage, Pose, Rgb, Tilt

MAX_MEDIAN_DEPTH_M = 100.0
"""Largest median depth in metres. The best depth cameras reach 30 m, but 0.1 m in millimetres is the number 100, so a
larger median means another unit."""
_EVERY_PIXEL = 4
"""Step in pixels between the samples for the median depth."""
MAX_STAMP_S = 4e9
"""Largest stamp in seconds, the year 2096 on a clock that starts in 1970. Nanoseconds of the same clock are about
10^18."""
MAX_STEP = 2**53
"""Largest step, because every part of a recording stores integers up to this value exactly."""
MAX_ODOMETRY_M = 1e6
"""Largest distance in metres from the origin of the odometry: a thousand kilometres."""


def check_observation(
    rgb: ArrayLike,
    depth: ArrayLike | None,
    odometry: Pose,
    *,
    stamp: float,
    step: FrameId,
    depth_scale: float = 1.0,
    exact_pose: Pose | None = None,
    original: OriginalImage | None = None,
    tilt: Tilt | None = None,
    source: str = "camera",
) -> Observation:
    """Return an observation, without resizing its images. Raises ImageError as `preprocess_observation` does."""
    image = check_rgb(rgb, source)
    pose, seconds, number = check_instant(odometry, stamp=stamp, step=step, source=source)
    metres = None if depth is None else _checked_depth(depth, depth_scale, source)
    if metres is not None and image.shape[:2] != metres.shape:
        raise ImageError(
            f"{source}: the image is {image.shape[1]} x {image.shape[0]} but its depth is "
            f"{metres.shape[1]} x {metres.shape[0]}; both must have the same size."
        )
    return Observation(
        rgb=image,
        depth=metres,
        odometry=pose,
        stamp=seconds,
        step=number,
        exact_pose=exact_pose,
        original=original,
        tilt=None if tilt is None else _checked_tilt(tilt, source),
    )


def check_instant(
    odometry: ArrayLike, *, stamp: SupportsFloat, step: SupportsIndex, source: str
) -> tuple[Pose, float, FrameId]:
    """Return the pose (3,), the time in seconds and the step of an image after checking them. Raises ImageError."""
    try:
        pose = np.asarray(odometry, np.float64)
    except (ValueError, TypeError, OverflowError):
        pose = np.empty(0)
    if pose.shape != (3,) or not np.all(np.isfinite(pose)) or np.abs(pose).max() > MAX_ODOMETRY_M:
        raise ImageError(
            f"{source}: odometry must be three finite numbers (x and y in metres, yaw in radians), got "
            f"{odometry!s:.60}."
        )
    try:
        seconds = float(stamp)
    except (ValueError, TypeError, OverflowError):
        seconds = np.nan
    if not abs(seconds) <= MAX_STAMP_S:
        raise ImageError(
            f"{source}: expected a finite stamp in seconds, got {stamp!s:.60}; divide nanoseconds (as ROS counts "
            "them) by 1e9."
        )
    try:
        number = operator.index(step)
    except TypeError:
        number = -MAX_STEP - 1
    if abs(number) > MAX_STEP:
        raise ImageError(
            f"{source}: the step must be a whole number of at most 2^53, got {step!s:.60}; count control steps from 0, "
            "and keep nanoseconds in the stamp, in seconds."
        )
    return pose, seconds, number


def check_rgb(rgb: ArrayLike, source: str) -> Rgb:
    """Return an image (H, W, 3) of uint8 after checking it. Raises ImageError."""
    image = _as_array(rgb, source)
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3 or 0 in image.shape:
        raise ImageError(
            f"{source}: expected an RGB image (height, width, 3) of uint8, got shape {image.shape} of {image.dtype}."
        )
    return image


def _checked_tilt(tilt: Tilt, source: str) -> Tilt:
    if not (np.all(np.isfinite(tilt)) and abs(tilt.pitch_rad) < np.pi / 2):
        raise ImageError(
            f"{source}: a camera's tilt must be two finite angles in radians, the pitch less than a right angle, got "
            f"{tilt!s:.60}."
        )
    return Tilt(float(tilt.pitch_rad), float(tilt.roll_rad))


def _as_array(value: ArrayLike, source: str) -> np.ndarray:
    try:
        return np.asarray(value)
    except (ValueError, TypeError, OverflowError) as error:  # Rows differ in length.
        raise ImageError(
            f"{source}: this is not an image, because its rows differ in length ({error!s:.80})."
        ) from error


def _checked_depth(depth: ArrayLike, scale: float, source: str) -> Depth:
    metres = _as_array(depth, source)
    if scale != 1.0 and np.issubdtype(metres.dtype, np.number):
        metres = metres * np.float32(scale)
    if metres.ndim != 2 or 0 in metres.shape or not np.issubdtype(metres.dtype, np.floating):
        raise ImageError(
            f"{source}: expected depth (height, width) as floating-point metres, got shape {metres.shape} of "
            f"{metres.dtype}; divide millimetres by 1000, or give a camera whose depth_scale is {MILLIMETRES}."
        )
    if np.isnan(metres).all():
        return np.zeros(metres.shape, np.float32)  # Some cameras return only NaN if nothing is in range.
    with np.errstate(over="ignore"):
        metres = metres.astype(np.float32, copy=False)  # First, because values that are too large become infinite here.
    if not np.all(np.isfinite(metres)) or metres.min() < 0:
        raise ImageError(f"{source}: depth holds NaN, infinite or negative values; mark pixels without a return as 0.")
    sparse = metres[::_EVERY_PIXEL, ::_EVERY_PIXEL]
    if sparse.max() > MAX_MEDIAN_DEPTH_M and (middle := float(np.median(sparse[sparse > 0]))) > MAX_MEDIAN_DEPTH_M:
        raise ImageError(
            f"{source}: half of the image is farther than {middle:,.0f} m, so its depth is not in metres; divide "
            f"millimetres by 1000, or give a camera whose depth_scale is {MILLIMETRES}."
        )
    return metres
