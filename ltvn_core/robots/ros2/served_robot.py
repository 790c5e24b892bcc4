"""Serves a robot of the toolkit as a robot of ROS 2: publishes its sensors and obeys commands, in real time.

The counterpart of `ros_robot`; with it, the simulated robot is a test double, and a simulator for other programs. Has a
drive lease of its own on the monotonic clock. Owns the timing, and the images in the format of `image_transport`:
colours as JPEG, depth as PNG of millimetres after a header.
"""

import math
import time
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np

from ltvn_core.cameras.camera_model import MILLIMETRES
from ltvn_core.errors import RobotError
from ltvn_core.geometry import relative
from ltvn_core.robots.drive_lease import DriveLease
from ltvn_core.robots.robot import Robot
from ltvn_core.robots.ros2.freshness import MOST_LATE_COMMAND_S, Freshness
from ltvn_core.robots.ros2.profile import RobotProfile
from ltvn_core.robots.ros2.robot_topics import RobotTopics
from ltvn_core.robots.ros2.ros_images import COMPRESSED_IMAGE, DEPTH_HEADER
from ltvn_core.robots.ros2.ros_messages import (
    CAMERA_FRAME,
    bumper_message,
    camera_info_message,
    header,
    image_message,
    odometry_message,
    read_twist,
    transform_message,
)
from ltvn_core.robots.ros2.topic_keys import type_store
from ltvn_core.robots.ros2.zenoh_link import Received, ZenohLink
from ltvn_core.types import CONTROL_STEP_S, ZERO_TWIST, Depth, Observation, Pose, Rgb, Twist

_QUALITY = 95
_FARTHEST = 65535
TURN_S = 0.02
"""Period in which the wheels receive commands, in seconds."""
_MOST_MADE_UP_S = 0.2
"""Greatest delay of the simulator that is caught up with, in seconds."""


def compressed_colour_message(rgb: Rgb, stamp_s: float) -> Any:
    """Return a CompressedImage with colours (H, W, 3) as JPEG."""
    _, jpeg = cv2.imencode(".jpg", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), (cv2.IMWRITE_JPEG_QUALITY, _QUALITY))
    return _compressed_message(jpeg.tobytes(), "rgb8; jpeg compressed bgr8", stamp_s)


def compressed_depth_message(depth: Depth, stamp_s: float) -> Any:
    """Return a CompressedImage with depth (H, W) in metres as a PNG of whole millimetres."""
    units = np.clip(np.nan_to_num(np.round(depth / MILLIMETRES), posinf=0), 0, _FARTHEST).astype(np.uint16)
    return _compressed_message(
        DEPTH_HEADER.pack(0, 0.0, 0.0) + cv2.imencode(".png", units)[1].tobytes(), "16UC1; compressedDepth png", stamp_s
    )


def _compressed_message(data: bytes, form: str, stamp_s: float) -> Any:
    content = np.frombuffer(data, np.uint8)
    return type_store().types[COMPRESSED_IMAGE](header=header(stamp_s, CAMERA_FRAME), format=form, data=content)


class ServedRobot:
    """A robot and the topics of its profile."""

    def __init__(
        self, robot: Robot, link: ZenohLink, profile: RobotProfile, *, truth: Callable[[], Pose] | None = None
    ) -> None:
        """Announce all topics, and subscribe to commands; `truth` returns the robot's true pose (3,)."""
        self._robot = robot
        self._lease = DriveLease(time.monotonic, limits=robot.spec.speeds)
        self._freshness = Freshness(profile.topics.command, most_late_s=MOST_LATE_COMMAND_S)
        self._seen: Observation | None = None
        topics = RobotTopics.of(profile)
        camera = profile.camera
        self._colour_message = compressed_colour_message if camera.compressed_colour else image_message
        self._depth_message = compressed_depth_message if camera.compressed_depth else image_message
        self._colour = link.publisher(topics.colour, best_effort=True)
        self._depth = link.publisher(topics.depth, best_effort=True)
        self._info = link.publisher(topics.camera_info, best_effort=True)
        self._edge = profile.odometry_transform
        self._odometry = link.publisher(topics.odometry)
        self._truth = truth
        self._true_pose = link.publisher(topics.truth) if topics.truth and truth else None
        self._bumper = link.publisher(topics.bumper) if topics.bumper else None
        self._source = topics.command.name
        link.subscribe(topics.command, self._take_command)

    def run(self, is_over: Callable[[], bool]) -> None:
        """Run in real time, and publish an image with odometry 10 times a second, until `is_over` returns True."""
        passed_s = time.monotonic()
        looked_s = -math.inf
        while not is_over():
            now_s = time.monotonic()
            if now_s - looked_s >= CONTROL_STEP_S:
                looked_s = now_s if now_s - looked_s > 2 * CONTROL_STEP_S else looked_s + CONTROL_STEP_S
                self._look()
            # The robot's own lease runs on simulated time, ours on real time; it expires even if this process was
            # stopped.
            self._robot.drive(self._lease.command())
            now_s = time.monotonic()
            self._robot.clock.advance(min(now_s - passed_s, _MOST_MADE_UP_S))
            passed_s = now_s
            time.sleep(TURN_S)
        self._robot.stop()

    def _look(self) -> None:
        stamp_s = time.time()
        seen = self._robot.observe()
        if self._edge is None:
            self._odometry.put(odometry_message(seen.odometry, self._speeds(seen), stamp_s))
        else:
            self._odometry.put(transform_message(seen.odometry, stamp_s, self._edge.parent, self._edge.child))
        if self._truth is not None and self._true_pose is not None:
            self._true_pose.put(odometry_message(self._truth(), ZERO_TWIST, stamp_s))
        if self._bumper is not None:
            self._bumper.put(bumper_message(pressed=self._robot.state().bumper_pressed))
        self._info.put(camera_info_message(self._robot.spec.camera, stamp_s))
        self._colour.put(self._colour_message(seen.rgb, stamp_s))
        if seen.depth is not None:
            self._depth.put(self._depth_message(seen.depth, stamp_s))

    def _speeds(self, seen: Observation) -> Twist:
        """Return the mean speeds since the last observation."""
        last, self._seen = self._seen, seen
        if last is None or seen.stamp <= last.stamp:
            return ZERO_TWIST
        ahead, _, turned = relative(last.odometry, seen.odometry) / (seen.stamp - last.stamp)
        return Twist(float(ahead), float(turned))

    def _take_command(self, received: Received) -> None:
        self._freshness.admit(received.attachment, received.arrived_s)
        try:
            self._lease.grant(read_twist(received.message, self._source))
        except RobotError:
            self._lease.cancel()  # A driver that sends invalid speeds is broken, and must not keep the robot moving.
            raise
