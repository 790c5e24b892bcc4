"""The door through which images come in: checks what a camera, a file or an upload delivers, and rectifies it.

Owns the rules for a valid image. Every image leaves it with the size and lens that a predictor asks for
(`Predictor.camera`); `ltvn_core.cameras.rectification` does the geometry. Does not know where an image came from; the
caller says so in `source`.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from ltvn_core.cameras.camera_model import MILLIMETRES, CameraModel
from ltvn_core.cameras.original_images import OriginalSize, compress_original, decompress_original
from ltvn_core.cameras.rectification import have_same_rays, rectification
from ltvn_core.errors import ImageError
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.types import Depth, FrameId, Observation, OriginalImage, Pose, Rgb

ORIGINAL_SIZE = OriginalSize()
"""Originals are kept as JPEGs of at most 320 x 240."""


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
        source: Where the image came from, for messages.

    Returns:
        The observation at the size of `target`. Pixels that the camera does not see are black and have depth 0; so a
        black pixel with depth tells that something black stands there.

    Raises:
        ImageError: A wrong type or shape, a size other than the camera's, depth with some pixels that are NaN, infinite
            or negative, or a pose or stamp that is not finite.
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
    source: str = "camera",
) -> Observation:
    """Return an observation of the size it came in. Raises ImageError as `preprocess_observation` does."""
    image = _checked_rgb(rgb, source)
    metres = None if depth is None else _checked_depth(depth, depth_scale, source)
    if metres is not None and image.shape[:2] != metres.shape:
        raise ImageError(
            f"{source}: the image is {image.shape[1]} x {image.shape[0]} but its depth is "
            f"{metres.shape[1]} x {metres.shape[0]}; both must have one size."
        )
    if not (np.all(np.isfinite(odometry)) and np.shape(odometry) == (3,) and np.isfinite(stamp)):
        raise ImageError(f"{source}: odometry must be three finite numbers and the stamp finite, got {odometry}.")
    return Observation(
        rgb=image,
        depth=metres,
        odometry=np.asarray(odometry, np.float64),
        stamp=stamp,
        step=step,
        exact_pose=exact_pose,
        original=original,
    )


def rectify_observation(
    observation: Observation,
    camera: CameraModel,
    target: CameraModel,
    *,
    original_size: OriginalSize | None = None,
) -> Observation:
    """Return an observation of `camera` as `target` would have taken it; the very same where the two agree.

    With an `original_size` the picture itself is kept too, see `Observation.original`.
    """
    if have_same_rays(camera, target):
        return observation
    way = rectification(camera, target)
    original = observation.original
    if original is None and original_size is not None:
        original = compress_original(observation.rgb, camera, original_size)
    return replace(
        observation,
        rgb=way.rectify_rgb(observation.rgb),
        depth=None if observation.depth is None else way.rectify_depth(observation.depth),
        original=original,
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
    if not have_same_rays(taken_by, target):
        rgb = rectification(taken_by, target).rectify_rgb(rgb)
    return replace(rectified, rgb=rgb)


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
    image = np.asarray(rgb)
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3 or 0 in image.shape:
        raise ImageError(
            f"{source}: expected an RGB picture (height, width, 3) of uint8, got shape {image.shape} of {image.dtype}."
        )
    return image


def _checked_depth(depth: ArrayLike, scale: float, source: str) -> Depth:
    metres = np.asarray(depth)
    if scale != 1.0 and np.issubdtype(metres.dtype, np.number):
        metres = metres * np.float32(scale)
    if metres.ndim != 2 or 0 in metres.shape or not np.issubdtype(metres.dtype, np.floating):
        raise ImageError(
            f"{source}: expected depth (height, width) as floating-point metres, got shape {metres.shape} of "
            f"{metres.dtype}; divide millimetres by 1000, or give a camera whose depth_scale is {MILLIMETRES}."
        )
    if np.isnan(metres).all():
        return np.zeros(metres.shape, np.float32)  # Some cameras say so where they saw nothing at all.
    if not np.all(np.isfinite(metres)) or metres.min() < 0:
        raise ImageError(f"{source}: depth holds NaN, infinite or negative values; mark pixels without a return as 0.")
    return metres.astype(np.float32, copy=False)
