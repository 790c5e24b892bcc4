"""Which types the sensors of a robot speak, by its profile: images plain or compressed, odometry or the tree."""

from ltvn_core.robots.ros2.profile import RobotProfile
from ltvn_core.robots.ros2.ros_images import COMPRESSED_IMAGE, IMAGE
from ltvn_core.robots.ros2.ros_types import ODOMETRY, TRANSFORMS
from ltvn_core.robots.ros2.topic_keys import Topic


def colour_topic(profile: RobotProfile) -> Topic:
    """Return the topic of the colours."""
    return Topic(profile.topics.colour, _image(compressed=profile.camera.compressed_colour), profile.domain)


def depth_topic(profile: RobotProfile) -> Topic:
    """Return the topic of depth."""
    return Topic(profile.topics.depth, _image(compressed=profile.camera.compressed_depth), profile.domain)


def odometry_topic(profile: RobotProfile) -> Topic:
    """Return the topic that says where the robot is."""
    kind = ODOMETRY if profile.odometry_transform is None else TRANSFORMS
    return Topic(profile.odometry_topic, kind, profile.domain)


def _image(*, compressed: bool) -> str:
    return COMPRESSED_IMAGE if compressed else IMAGE
