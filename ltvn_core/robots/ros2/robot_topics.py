"""The topics of a robot of ROS 2 with their types, by its profile. The robot, its guard and the served robot use the
same.
"""

from typing import NamedTuple, Self

from ltvn_core.robots.ros2.profile import RobotProfile
from ltvn_core.robots.ros2.ros_cameras import CAMERA_INFO
from ltvn_core.robots.ros2.ros_images import COMPRESSED_IMAGE, IMAGE
from ltvn_core.robots.ros2.topic_keys import (
    BATTERY,
    BUMPER,
    DIAGNOSTIC,
    ODOMETRY,
    TRANSFORMS,
    Topic,
    command_type,
)


class RobotTopics(NamedTuple):
    """Topics of sensors, commands and the guard; None for a sensor that the robot lacks."""

    colour: Topic
    depth: Topic
    camera_info: Topic
    odometry: Topic
    """An Odometry, or the tf tree."""
    command: Topic
    guard: Topic
    """Commands that the guard checks and forwards."""
    guard_status: Topic
    battery: Topic | None
    bumper: Topic | None
    truth: Topic | None

    @classmethod
    def of(cls, profile: RobotProfile) -> Self:
        """Return the topics of a profile."""
        topics, driving, domain = profile.topics, profile.driving, profile.domain
        images = {True: COMPRESSED_IMAGE, False: IMAGE}
        twist = command_type(stamped=driving.stamped)
        return cls(
            colour=Topic(topics.colour, images[profile.camera.compressed_colour], domain),
            depth=Topic(topics.depth, images[profile.camera.compressed_depth], domain),
            camera_info=Topic(topics.camera_info, CAMERA_INFO, domain),
            odometry=Topic(profile.odometry_topic, TRANSFORMS if profile.odometry_transform else ODOMETRY, domain),
            command=Topic(topics.command, twist, domain),
            guard=Topic(driving.guard_topic, twist, domain),
            guard_status=Topic(f"{driving.guard_topic}_status", DIAGNOSTIC, domain),
            battery=Topic(topics.battery, BATTERY, domain) if topics.battery else None,
            bumper=Topic(topics.bumper, BUMPER, domain) if topics.bumper else None,
            truth=Topic(topics.truth, ODOMETRY, domain) if topics.truth else None,
        )
