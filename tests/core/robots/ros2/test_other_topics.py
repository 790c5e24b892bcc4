"""What some robots of ROS 2 say in another way: where they are, by the tree of frames, and what they see."""

import time
from contextlib import closing
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from ltvn_core.errors import RobotError
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.robots.ros2.guard import DepthStop
from ltvn_core.robots.ros2.robot_probe import look_over
from ltvn_core.robots.ros2.ros_messages import (
    bumper_message,
    camera_info_message,
    odometry_message,
    read_battery,
    transform_message,
)
from ltvn_core.robots.ros2.sensor_inbox import SensorInbox
from ltvn_core.robots.ros2.served_robot import compressed_depth_message
from ltvn_core.robots.ros2.topic_keys import TRANSFORMS, Attachment, Topic
from ltvn_core.robots.ros2.zenoh_link import Received, ZenohLink
from ltvn_core.types import Observation, RobotState, Twist
from tests.core.flat_world import FlatRobot, one_room
from tests.core.robots.ros2.served_here import changed_profile, opened, served_here
from tests.waiting import until

TREE = changed_profile(('odometry = "/odom"\n', ""), ("[driving]", "[odometry_transform]\nchild = 'base'\n\n[driving]"))
PLACE = (1.0, 1.5, 0.5)


class PlacedRobot(FlatRobot):
    """Stands where its odometry is not zero, and sees one colour at one distance."""

    def __init__(self) -> None:
        super().__init__(one_room(), PLACE)
        self.touches = False
        self.size: tuple[int, int] = (72, 96)

    def observe(self) -> Observation:
        rgb = np.full((*self.size, 3), (200, 100, 30), np.uint8)
        depth = np.full(self.size, 1.5, np.float32)
        return replace(super().observe(), odometry=np.array(PLACE), rgb=rgb, depth=depth)

    def state(self) -> RobotState:
        return super().state()._replace(bumper_pressed=self.touches)


def _publish_another_part(address: str) -> None:
    with ZenohLink.connect(address, node="localiser") as link:
        place = link.publisher(Topic("/tf", TRANSFORMS))
        until(lambda: place.has_listener)
        place.put(transform_message(np.zeros(3), time.time(), "map", "odom"))


def test_odometry_comes_from_the_tree_of_frames() -> None:
    with served_here(PlacedRobot(), TREE) as address, closing(opened(address, TREE)) as robot:
        np.testing.assert_allclose(robot.observe().odometry, PLACE)
        np.testing.assert_allclose(robot.state().odometry, PLACE)
        _publish_another_part(address)
        count = robot.inbox.odometry.count
        until(lambda: robot.inbox.odometry.count > count + 2)
        assert robot.inbox.odometry.refusal is None


def test_a_transform_that_never_comes_is_named() -> None:
    inbox = SensorInbox(TREE)
    inbox.take_transforms(_received(transform_message(np.zeros(3), 1.0, "odom", "camera")))
    assert "no transform from odom to base" in inbox.complaint(2.0)


def test_compressed_images_are_seen_and_a_change_of_their_size_is_refused() -> None:
    profile = changed_profile(("[camera]", "[camera]\ncompressed_colour = true\ncompressed_depth = true"))
    served = PlacedRobot()
    with served_here(served, profile) as address, closing(opened(address, profile)) as robot:
        seen = robot.observe()
        np.testing.assert_allclose(seen.rgb[40, 40], (200, 100, 30), atol=3)
        np.testing.assert_allclose(seen.require_depth("a test"), 1.5, rtol=1e-5)
        served.size = 144, 192
        with pytest.raises(RobotError, match=r"image_raw is now 192 x 144, but .* was 96 x 72"):
            until(lambda: robot.observe() is None)


def test_plain_images_where_compressed_ones_were_promised_are_named() -> None:
    profile = changed_profile(("[camera]", "[camera]\ncompressed_colour = true"))
    said = "sensor_msgs/msg/Image, expected sensor_msgs/msg/CompressedImage"
    with served_here(PlacedRobot(), changed_profile()) as address:

        def is_named() -> bool:
            with pytest.raises(RobotError, match="image_raw never came") as refused:
                opened(address, profile, patience_s=0.3)
            return said in str(refused.value)

        until(is_named)


def test_the_guard_looks_at_compressed_depth_in_the_unit_of_its_robot() -> None:
    profile = changed_profile(("[camera]", "[camera]\ncompressed_depth = true\ndepth_unit_m = 0.0001"))
    guard, ahead = DepthStop(profile, 0.3), Twist(0.3, 0.0)
    guard.take_camera_info(_received(camera_info_message(LOCOBOT.camera, 1.0)))
    message = compressed_depth_message(np.full((72, 96), 0.35, np.float32), 1.0)
    tenths = cv2.imencode(".png", np.full((72, 96), 3500, np.uint16))[1].tobytes()
    message.data = np.frombuffer(bytes(12) + tenths, np.uint8)
    guard.take_depth(_received(message))
    assert guard.allows(ahead).linear_m_s == 0
    assert "there is an obstacle 0.17 m in front of the robot" in str(guard.reason)


def _received(message: Any) -> Received:
    return Received(message, Attachment(1, 0, bytes(16)), time.monotonic())


def test_what_the_bumper_feels_is_in_the_state() -> None:
    profile, served = changed_profile(), PlacedRobot()
    with served_here(served, profile) as address, closing(opened(address, profile)) as robot:
        assert not robot.state().bumper_pressed
        served.touches = True
        until(lambda: robot.state().bumper_pressed)
        served.touches = False
        until(lambda: not robot.state().bumper_pressed)


def test_a_touch_between_two_questions_is_felt() -> None:
    inbox = SensorInbox(changed_profile())
    for pressed in (True, False):
        inbox.take_bumper(_received(bumper_message(pressed=pressed)))
    now_s = time.monotonic()
    assert inbox.bumper_pressed(now_s)
    assert not inbox.bumper_pressed(now_s + 1.0)


def test_a_true_pose_that_comes_late_is_not_where_the_robot_is() -> None:
    inbox = SensorInbox(changed_profile())
    pose = odometry_message(np.zeros(3), Twist(0.0, 0.0), 1.0)
    inbox.take_truth(Received(pose, Attachment(1, 0, bytes(16)), 50.0))
    with pytest.raises(RobotError, match="late"):
        inbox.take_truth(Received(pose, Attachment(2, 10**9, bytes(16)), 52.0))
    assert [each.arrived_s for each in inbox.truth.kept] == [50.0]


@pytest.mark.parametrize(("percentage", "charge"), [(0.5, 0.5), (1.0, 1.0), (55.0, None), (-1.0, None), (np.nan, None)])
def test_a_charge_that_is_no_share_is_unknown(percentage: float, charge: float | None) -> None:
    assert read_battery(SimpleNamespace(percentage=percentage)) == charge


def test_the_check_names_a_bumper_that_nobody_publishes() -> None:
    without = changed_profile(('bumper = "/bumper"\n', ""))
    with served_here(PlacedRobot(), without) as address, closing(opened(address, changed_profile())) as robot:
        doubts = look_over(robot, seconds=0.5, drives=False).doubts
    assert [doubt for doubt in doubts if "publishes /bumper" in doubt]
