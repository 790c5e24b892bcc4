"""Entry of all images: checks what a camera, a file or an upload delivers, and rectifies it.

Every image leaves it with the size and lens that a predictor asks for (`Predictor.camera`). What a valid image is says
`ltvn_core.image_validity`, and `ltvn_core.cameras.rectification` does the geometry. Does not know where an image came
from; the caller says so in `source`.
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
    tilt: Tilt | None = None,
    source: str = "camera",
) -> Observation:
    """Check an image with its depth and odometry, and rectify both to the camera that a predictor asks for.

    Args: rgb: (H, W, 3) uint8. depth: (H, W) metres as floating-point numbers, 0 = no return, or whole units of
    `camera.depth_scale`; None where the robot has no depth camera. Zero or NaN everywhere is an image without depth: it
    is accepted, marked by `Observation.has_depth`. odometry: (3,) x, y, yaw. stamp: Seconds on the robot's clock. step:
    Names the image. camera: The camera that took it. None stands for a centred lens that shows as much as `target`,
    level, with square pixels: what of the picture is too wide or too high is cut off. target: The camera of the result:
    `Predictor.camera`. original_size: Keep the picture itself too, as a JPEG of at most this size, where it is another
    than the result. exact_pose: (3,) the true pose, in simulation only. tilt: How the camera was tilted then, where
    that changes; in place of what `camera` says. source: Where the image came from, for messages.

    Returns:
        The observation at the size of `target`. Pixels that the camera does not see are black and have depth 0; so a
        black pixel with depth tells that something black stands there.

    Raises: ImageError: A wrong type or shape, a size other than the camera's, depth with some pixels that are NaN,
    infinite or negative, depth in another unit, a pose that is not finite, a stamp that is not a time in seconds, or a
    step that is not a whole number.
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


def continued_observation(
    observation: Observation, *, steps: int, seconds: float, source: str = "camera"
) -> Observation:
    """Check an observation whose step and stamp go on from those of a map: these many steps and seconds are added."""
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
    """Return an observation of `camera` as `target` would have taken it; the very same where the two agree.

    An image with its own tilt is turned from that tilt to the target's, and has none then; where the two cameras
    have the same lens it is left as it was taken, for then neither's mounting says how it was held. With an
    `original_size` the picture itself is kept too, see `Observation.original`.
    """
    if have_same_rays(camera, target) or (observation.tilt is not None and have_same_lens(camera, target)):
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
    rgb = decompress_original(observation.original)
    taken_by = observation.original.camera
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
    image = check_rgb(rgb, source)
    camera = _matching_camera(image, camera, target, source)
    return image if have_same_rays(camera, target) else rectification(camera, target).rectify_rgb(image)


def _matching_camera(image: Rgb, camera: CameraModel | None, target: CameraModel, source: str) -> CameraModel:
    """Return the camera of an image; if it is unknown, one that shows at least as much as `target`."""
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
