"""The door through which images come in: checks what a camera, a file or an upload delivers and makes it 96 x 72.

Owns the rules for a valid picture. Does not know where the picture came from; the caller says so in `source`.
"""

import cv2
import numpy as np
from numpy.typing import ArrayLike

from ltvn_core.errors import ImageError
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.types import Depth, FrameId, Observation, Pose, Rgb


def preprocess_observation(
    rgb: ArrayLike,
    depth: ArrayLike | None,
    odometry: Pose,
    *,
    stamp: float,
    step: FrameId,
    exact_pose: Pose | None = None,
    source: str = "camera",
) -> Observation:
    """Check a look at the world and resize it to the method's 96 x 72.

    Takes rgb (H, W, 3) uint8, depth (H, W) in metres (0 = no return) and odometry (3,).
    Raises ImageError for a wrong type or shape, for depth that is NaN, infinite, negative or zero everywhere, and for
    a pose or stamp that is not finite.
    """
    image, metres = _checked_rgb(rgb, source), None if depth is None else _checked_depth(depth, source)
    if metres is not None and image.shape[:2] != metres.shape:
        raise ImageError(
            f"{source}: the picture is {image.shape[1]} x {image.shape[0]} but its depth is "
            f"{metres.shape[1]} x {metres.shape[0]}; both must have one size."
        )
    if not (np.all(np.isfinite(odometry)) and np.shape(odometry) == (3,) and np.isfinite(stamp)):
        raise ImageError(f"{source}: odometry must be three finite numbers and the stamp finite, got {odometry}.")
    return Observation(
        _resized(image),
        None if metres is None else _resized(metres),
        np.asarray(odometry, np.float64),
        stamp,
        step,
        exact_pose,
    )


def preprocess_image(rgb: ArrayLike, source: str) -> Rgb:
    """Check a picture without depth (H, W, 3) uint8, such as an upload, and resize it to 96 x 72."""
    return _resized(_checked_rgb(rgb, source))


def _checked_rgb(rgb: ArrayLike, source: str) -> Rgb:
    image = np.asarray(rgb)
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3 or 0 in image.shape:
        raise ImageError(
            f"{source}: expected an RGB picture (height, width, 3) of uint8, got shape {image.shape} of {image.dtype}."
        )
    return image


def _checked_depth(depth: ArrayLike, source: str) -> Depth:
    metres = np.asarray(depth)
    if metres.ndim != 2 or 0 in metres.shape or not np.issubdtype(metres.dtype, np.floating):
        raise ImageError(
            f"{source}: expected depth (height, width) as floating-point metres, got shape {metres.shape} of "
            f"{metres.dtype}; divide millimetres by 1000."
        )
    if not np.all(np.isfinite(metres)) or metres.min() < 0:
        raise ImageError(f"{source}: depth holds NaN, infinite or negative values; mark pixels without a return as 0.")
    if not metres.any():
        raise ImageError(f"{source}: depth is zero everywhere; is the depth camera running?")
    return metres.astype(np.float32, copy=False)


def _resized(image: np.ndarray) -> np.ndarray:
    if image.shape[:2] == (LOCOBOT.camera.height, LOCOBOT.camera.width):
        return image
    # Depth must not be averaged across edges or with missing returns, so it takes the nearest pixel.
    mode = cv2.INTER_NEAREST if image.ndim == 2 else cv2.INTER_AREA
    return cv2.resize(image, (LOCOBOT.camera.width, LOCOBOT.camera.height), interpolation=mode)
