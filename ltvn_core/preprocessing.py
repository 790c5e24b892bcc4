"""Entry of all images: checks the input from a camera, a file or an upload, and rectifies it.

Every resulting image has the size and lens that a predictor needs (`Predictor.camera`). `ltvn_core.image_validity`
defines valid images, and `ltvn_core.cameras.rectification` does the geometry. The origin of an image is unknown here;
the caller gives it as `source`.
"""

from dataclasses import replace

from numpy.typing import ArrayLike

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.cameras.original_images import OriginalSize, compress_original, decompress_original
from ltvn_core.cameras.rectification import Rectification, have_same_lens, have_same_rays, rectification
from ltvn_core.errors import ImageError
from ltvn_core.image_validity import check_observation, check_rgb
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.types import FrameId, Observation, Pose, Rgb, Tilt

ORIGINAL_SIZE = OriginalSize()
"""Largest size of original images, which are kept as JPEG: 320 x 240 pixels."""


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
        rgb: Colours (H, W, 3) uint8.
        depth: Depth (H, W) in metres as floating-point numbers, 0 = no return, or in whole units of
            `camera.depth_scale`; None if the robot has no depth camera. An image with only zeros or only NaN counts as
            one without depth: it is accepted, and marked by `Observation.has_depth`.
        odometry: Pose (3,): x, y, yaw.
        stamp: Time in seconds on the robot's clock.
        step: Id of the image.
        camera: Camera that took the image. None assumes a level camera with square pixels and a centred lens, whose
            image contains the view of `target`; parts of the image outside of that view are cut off.
        target: Camera of the result: `Predictor.camera`.
        original_size: If given, the original image is kept too, as a JPEG of at most this size, unless it equals the
            result.
        exact_pose: True pose (3,), in simulation only.
        tilt: Tilt of the camera at this image, if it changes; replaces the tilt of `camera`.
        source: Origin of the image, for messages.

    Returns:
        The observation at the size of `target`. Pixels that the camera does not see are black and have depth 0; so a
        black pixel with depth shows a black object.

    Raises:
        ImageError: A wrong type or shape, a size other than the camera's, depth with some NaN, infinite or negative
            pixels, depth in another unit, a pose that is not finite, a stamp that is not a time in seconds, or a step
            that is not a whole number.
    """
    image = check_rgb(rgb, source)
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
    """Check and rectify an observation that was taken by `camera`; see `preprocess_observation`."""
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


def continued_observation(
    observation: Observation, *, steps: int, seconds: float, source: str = "camera"
) -> Observation:
    """Check an observation that continues a map; `steps` and `seconds` are added to its step and stamp."""
    return check_observation(
        observation.rgb,
        observation.depth,
        observation.odometry,
        stamp=observation.stamp + seconds,
        step=observation.step + steps,
        exact_pose=observation.exact_pose,
        original=observation.original,
        tilt=observation.tilt,
        source=source,
    )


def rectify_observation(
    observation: Observation,
    camera: CameraModel,
    target: CameraModel,
    *,
    original_size: OriginalSize | None = None,
) -> Observation:
    """Return an observation of `camera` as `target` would have taken it; the same object if no change is needed.

    An image with its own tilt is rotated to the target's tilt, and then has no tilt of its own. If the two cameras have
    the same lens, such an image stays unchanged. With an `original_size`, the original image is kept too, see
    `Observation.original`.
    """
    if have_same_rays(camera, target) or (observation.tilt is not None and have_same_lens(camera, target)):
        return observation
    way = _way_of(camera, observation.tilt, target)
    original = observation.original
    if original is None and original_size is not None:
        original = compress_original(observation.rgb, camera, original_size)
        if have_same_rays(original.camera, target):
            original = None  # The result already is the original image.
    return replace(
        observation,
        rgb=way.rectify_rgb(observation.rgb),
        depth=None if observation.depth is None else way.rectify_depth(observation.depth),
        original=original,
        tilt=None,
    )


def recorded_observation(observation: Observation, camera: CameraModel, target: CameraModel) -> Observation:
    """Return a recorded observation for a predictor with another camera than that of the recording.

    Colours come from the original image if it was kept, so that the predictor may use larger images than the method
    used then; depth comes from the recorded image.

    Args:
        observation: As `Recording.observation` returns it.
        camera: The camera of its image: `Recording.meta.camera`.
        target: The camera of the result: `Predictor.camera`.
    """
    rectified = rectify_observation(observation, camera, target)
    if observation.original is None or rectified is observation:
        return rectified
    rgb = decompress_original(observation.original)
    taken_by = observation.original.camera
    if observation.tilt is not None or not have_same_rays(taken_by, target):
        rgb = _way_of(taken_by, observation.tilt, target).rectify_rgb(rgb)
    return replace(rectified, rgb=rgb)


def _way_of(camera: CameraModel, tilt: Tilt | None, target: CameraModel) -> Rectification:
    if tilt is None:
        return rectification(camera, target)
    # Not cached: each image has its own tilt, and would displace rectifications that are used again.
    return Rectification(replace(camera, pitch_rad=tilt.pitch_rad, roll_rad=tilt.roll_rad), target)


def preprocess_image(
    rgb: ArrayLike, source: str, *, camera: CameraModel | None = None, target: CameraModel = LOCOBOT.camera
) -> Rgb:
    """Check an image (H, W, 3) uint8 without depth, such as an upload, and rectify it; see `preprocess_observation`."""
    image = check_rgb(rgb, source)
    camera = _matching_camera(image, camera, target, source)
    return image if have_same_rays(camera, target) else rectification(camera, target).rectify_rgb(image)


def _matching_camera(image: Rgb, camera: CameraModel | None, target: CameraModel, source: str) -> CameraModel:
    """Return the camera of an image; if it is unknown, assume one whose image contains the view of `target`."""
    height, width = image.shape[:2]
    if camera is None:
        return _assumed_camera(width, height, target)
    if (camera.width, camera.height) != (width, height):
        raise ImageError(
            f"{source}: the image is {width} x {height} but its camera's images are {camera.width} x {camera.height}; "
            "give a camera of this size, for instance with `CameraModel.scaled`."
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
