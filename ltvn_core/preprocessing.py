"""The door through which images come in: checks what a camera, a file or an upload delivers, and rectifies it.

Owns the rules for a valid image. Every image leaves it with the size and lens that a predictor asks for
(`Predictor.camera`); `ltvn_core.cameras.rectification` does the geometry. Does not know where an image came from; the
caller says so in `source`.
"""

import operator
from dataclasses import replace
from typing import SupportsFloat, SupportsIndex

import numpy as np
from numpy.typing import ArrayLike

from ltvn_core.cameras.camera_model import MILLIMETRES, CameraModel
from ltvn_core.cameras.original_images import OriginalSize, compress_original, decompress_original
from ltvn_core.cameras.rectification import Rectification, have_same_rays, rectification
from ltvn_core.errors import ImageError
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.types import Depth, FrameId, Observation, OriginalImage, Pose, Rgb, Tilt

ORIGINAL_SIZE = OriginalSize()
"""Originals are kept as JPEGs of at most 320 x 240."""

MAX_MEDIAN_DEPTH_M = 100.0
"""No depth camera sees so far (the best reach 30 m), but 0.1 m in millimetres is 100: half of the pixels of an image
that are farther mean another unit."""
_EVERY_PIXEL = 4
"""Of these the median is taken."""
MAX_STAMP_S = 4e9
"""Seconds; the year 2096 on a clock that counts from 1970. Nanoseconds of the same clock are 10^18."""
MAX_STEP = 2**53
"""The largest whole number that every part of a recording keeps exactly."""
MAX_ODOMETRY_M = 1e6
"""A thousand kilometres from where odometry began."""


def preprocess_observation(
    rgb: ArrayLike,
    depth: ArrayLike | None,
    odometry: Pose,
    *,
    stamp: float,
    step: FrameId,
    camera: CameraModel | None = None,
    target: CameraModel = LOCOBOT.camera,
    original_size: OriginalSize | None = None,
    exact_pose: Pose | None = None,
    tilt: Tilt | None = None,
    source: str = "camera",
) -> Observation:
    """Check an image with its depth and odometry, and rectify both to the camera that a predictor asks for.

    Args:
        rgb: (H, W, 3) uint8.
        depth: (H, W) metres as floating-point numbers, 0 = no return, or whole units of `camera.depth_scale`; None
            where the robot has no depth camera. Zero or NaN everywhere is an image without depth: it comes in, marked
            by `Observation.has_depth`.
        odometry: (3,) x, y, yaw.
        stamp: Seconds on the robot's clock.
        step: Names the image.
        camera: The camera that took it. None stands for a centred lens that shows as much as `target`, level, with
            square pixels: what of the picture is too wide or too high is cut off.
        target: The camera of the result: `Predictor.camera`.
        original_size: Keep the picture itself too, as a JPEG of at most this size, where it is another than the result.
        exact_pose: (3,) the true pose, in simulation only.
        tilt: How the camera was tilted then, where that changes; in place of what `camera` says.
        source: Where the image came from, for messages.

    Returns:
        The observation at the size of `target`. Pixels that the camera does not see are black and have depth 0; so a
        black pixel with depth tells that something black stands there.

    Raises:
        ImageError: A wrong type or shape, a size other than the camera's, depth with some pixels that are NaN, infinite
            or negative, depth in another unit, a pose that is not finite, a stamp that is no time in seconds, or a step
            that is no whole number.
    """
    image = _checked_rgb(rgb, source)
    camera = _matching_camera(image, camera, target, source)
    observation = check_observation(
        image,
        depth,
        odometry,
        stamp=stamp,
        step=step,
        depth_scale=camera.depth_scale,
        exact_pose=exact_pose,
        tilt=tilt,
        source=source,
    )
    return rectify_observation(observation, camera, target, original_size=original_size)


def admit_observation(
    observation: Observation,
    camera: CameraModel,
    target: CameraModel,
    *,
    original_size: OriginalSize | None = None,
    source: str = "camera",
) -> Observation:
    """Check and rectify an observation as a robot with that camera takes it; see `preprocess_observation`."""
    return preprocess_observation(
        observation.rgb,
        observation.depth,
        observation.odometry,
        stamp=observation.stamp,
        step=observation.step,
        camera=camera,
        target=target,
        original_size=original_size,
        exact_pose=observation.exact_pose,
        tilt=observation.tilt,
        source=source,
    )


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
    """Return an observation of the size it came in. Raises ImageError as `preprocess_observation` does."""
    image = _checked_rgb(rgb, source)
    pose, seconds, number = check_instant(odometry, stamp=stamp, step=step, source=source)
    metres = None if depth is None else _checked_depth(depth, depth_scale, source)
    if metres is not None and image.shape[:2] != metres.shape:
        raise ImageError(
            f"{source}: the image is {image.shape[1]} x {image.shape[0]} but its depth is "
            f"{metres.shape[1]} x {metres.shape[0]}; both must have one size."
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
    """Return where and when an image was taken: the pose (3,), seconds and the step. Raises ImageError."""
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
            f"{source}: expected the stamp finite and in seconds, got {stamp!s:.60}; divide nanoseconds (as ROS counts "
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


def rectify_observation(
    observation: Observation,
    camera: CameraModel,
    target: CameraModel,
    *,
    original_size: OriginalSize | None = None,
) -> Observation:
    """Return an observation of `camera` as `target` would have taken it; the very same where the two agree.

    An image with a tilt of its own is turned from that tilt to the target's, and has none then; where the two cameras
    agree it is left as it was taken. With an `original_size` the picture itself is kept too, see
    `Observation.original`.
    """
    if have_same_rays(camera, target):
        return observation
    way = _way_of(camera, observation.tilt, target)
    original = observation.original
    if original is None and original_size is not None:
        original = compress_original(observation.rgb, camera, original_size)
        if have_same_rays(original.camera, target):
            original = None  # The result is that picture.
    return replace(
        observation,
        rgb=way.rectify_rgb(observation.rgb),
        depth=None if observation.depth is None else way.rectify_depth(observation.depth),
        original=original,
        tilt=None,
    )


def recorded_observation(observation: Observation, camera: CameraModel, target: CameraModel) -> Observation:
    """Return a recorded observation for a predictor with another camera than the one it was recorded for.

    Colours come from the original picture where it was kept, so that a predictor may take larger images than the method
    used then; depth comes from what the method used.

    Args:
        observation: As `Recording.observation` returns it.
        camera: The camera of its image: `Recording.meta.camera`.
        target: The camera of the result: `Predictor.camera`.
    """
    rectified = rectify_observation(observation, camera, target)
    if observation.original is None or rectified is observation:
        return rectified
    rgb, taken_by = decompress_original(observation.original), observation.original.camera
    if observation.tilt is not None or not have_same_rays(taken_by, target):
        rgb = _way_of(taken_by, observation.tilt, target).rectify_rgb(rgb)
    return replace(rectified, rgb=rgb)


def _way_of(camera: CameraModel, tilt: Tilt | None, target: CameraModel) -> Rectification:
    if tilt is None:
        return rectification(camera, target)
    # Not by the function that remembers: each image has a tilt of its own, and would push out what is used again.
    return Rectification(replace(camera, pitch_rad=tilt.pitch_rad, roll_rad=tilt.roll_rad), target)


def preprocess_image(
    rgb: ArrayLike, source: str, *, camera: CameraModel | None = None, target: CameraModel = LOCOBOT.camera
) -> Rgb:
    """Check an image without depth (H, W, 3) uint8, such as an upload, and rectify it, see `preprocess_observation`."""
    image = _checked_rgb(rgb, source)
    camera = _matching_camera(image, camera, target, source)
    return image if have_same_rays(camera, target) else rectification(camera, target).rectify_rgb(image)


def _matching_camera(image: Rgb, camera: CameraModel | None, target: CameraModel, source: str) -> CameraModel:
    """Return the camera of an image; where nobody knows it, one that shows at least as much as `target`."""
    height, width = image.shape[:2]
    if camera is None:
        return _assumed_camera(width, height, target)
    if (camera.width, camera.height) != (width, height):
        raise ImageError(
            f"{source}: the image is {width} x {height} but its camera takes {camera.width} x {camera.height}; give "
            "the camera of this size, for instance with `CameraModel.scaled`."
        )
    return camera


def _assumed_camera(width: int, height: int, target: CameraModel) -> CameraModel:
    scale = min(width / target.width, height / target.height)
    return replace(
        target,
        width=width,
        height=height,
        fx=target.fx * scale,
        fy=target.fy * scale,
        cx=(width - 1) / 2 + (target.cx - (target.width - 1) / 2) * scale,
        cy=(height - 1) / 2 + (target.cy - (target.height - 1) / 2) * scale,
    )


def _checked_rgb(rgb: ArrayLike, source: str) -> Rgb:
    image = _as_array(rgb, source)
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3 or 0 in image.shape:
        raise ImageError(
            f"{source}: expected an RGB picture (height, width, 3) of uint8, got shape {image.shape} of {image.dtype}."
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
    except (ValueError, TypeError, OverflowError) as error:  # Rows of different lengths.
        raise ImageError(f"{source}: this is no picture, for its rows differ in length ({error!s:.80}).") from error


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
        return np.zeros(metres.shape, np.float32)  # Some cameras say so where they saw nothing at all.
    with np.errstate(over="ignore"):
        metres = metres.astype(np.float32, copy=False)  # First, because what is too large becomes infinite here.
    if not np.all(np.isfinite(metres)) or metres.min() < 0:
        raise ImageError(f"{source}: depth holds NaN, infinite or negative values; mark pixels without a return as 0.")
    sparse = metres[::_EVERY_PIXEL, ::_EVERY_PIXEL]
    if sparse.max() > MAX_MEDIAN_DEPTH_M and (middle := float(np.median(sparse[sparse > 0]))) > MAX_MEDIAN_DEPTH_M:
        raise ImageError(
            f"{source}: half of the image is farther than {middle:,.0f} m, so its depth is not in metres; divide "
            f"millimetres by 1000, or give a camera whose depth_scale is {MILLIMETRES}."
        )
    return metres
