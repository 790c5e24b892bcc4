"""The sensors of a live robot: their topics and types from its profile, and the checks of their images.

The size of an image is checked before the image is decoded. The decoding itself is in `ros_images`.
"""

from typing import Any

from ltvn_core.errors import LtvnError, RobotError
from ltvn_core.robots.ros2.profile import RobotProfile
from ltvn_core.robots.ros2.ros_images import COMPRESSED_IMAGE, IMAGE, decode_colours, decode_metres, image_size
from ltvn_core.robots.ros2.topic_keys import ODOMETRY, TRANSFORMS, Topic
from ltvn_core.types import Depth, Rgb

MOST_PIXELS = 16_000_000
"""Maximum number of pixels of an image; decoding a larger one would delay the robot."""


def colour_topic(profile: RobotProfile) -> Topic:
    """Return the topic of the colours."""
    return Topic(profile.topics.colour, _image(compressed=profile.camera.compressed_colour), profile.domain)


def depth_topic(profile: RobotProfile) -> Topic:
    """Return the topic of depth."""
    return Topic(profile.topics.depth, _image(compressed=profile.camera.compressed_depth), profile.domain)


def odometry_topic(profile: RobotProfile) -> Topic:
    """Return the topic of odometry."""
    kind = ODOMETRY if profile.odometry_transform is None else TRANSFORMS
    return Topic(profile.odometry_topic, kind, profile.domain)


def _image(*, compressed: bool) -> str:
    return COMPRESSED_IMAGE if compressed else IMAGE


def sensor_size(message: Any, topic: str) -> tuple[int, int]:
    """Return width and height of an image of a topic. Raises RobotError if it is invalid or too large."""
    try:
        width, height = image_size(message, topic)
    except LtvnError as error:
        raise RobotError(str(error)) from error
    if not 0 < width * height <= MOST_PIXELS:
        raise RobotError(f"{topic}: {width} x {height} pixels is not a valid size of a camera image.")
    return width, height


def sensor_colours(message: Any, topic: str) -> Rgb:
    """Return the colours (H, W, 3) of an image whose size was checked. Raises RobotError."""
    try:
        return decode_colours(message, topic)
    except LtvnError as error:
        raise RobotError(str(error)) from error


def sensor_depth(message: Any, topic: str, unit_m: float) -> Depth:
    """Return depth (H, W) in metres of an image whose size was checked; integers are in units of `unit_m`.

    Raises RobotError.
    """
    try:
        return decode_metres(message, topic, unit_m)
    except LtvnError as error:
        raise RobotError(str(error)) from error
