"""What some robots of ROS 2 say in another way: where they are, by the tree of frames."""

import time
from dataclasses import replace

import numpy as np
import pytest

from ltvn_core.errors import RobotError
from ltvn_core.robots.ros2.profile import RobotProfile
from ltvn_core.robots.ros2.ros_messages import transform_message
from ltvn_core.robots.ros2.ros_robot import RosRobot
from ltvn_core.robots.ros2.ros_types import TRANSFORMS
from ltvn_core.robots.ros2.topic_keys import Topic
from ltvn_core.robots.ros2.zenoh_link import ZenohLink
from ltvn_core.types import Observation
from tests.core.flat_world import FlatRobot, one_room
from tests.core.robots.ros2.served_here import changed_profile, served_here
from tests.waiting import until

TREE = changed_profile(('odometry = "/odom"\n', ""), ("[driving]", "[odometry_transform]\nchild = 'base'\n\n[driving]"))
PLACE = (1.0, 1.5, 0.5)


class PlacedRobot(FlatRobot):
    """Stands where its odometry is not zero."""

    def __init__(self) -> None:
        super().__init__(one_room(), PLACE)

    def observe(self) -> Observation:
        return replace(super().observe(), odometry=np.array(PLACE))


def opened(address: str, profile: RobotProfile, patience_s: float = 30.0) -> RosRobot:
    link = ZenohLink.connect(address, node="ltvn")
    try:
        return RosRobot(link, profile, patience_s=patience_s)
    except RobotError:
        link.close()
        raise


def _publish_another_part(address: str) -> None:
    with ZenohLink.connect(address, node="localiser") as link:
        place = link.publisher(Topic("/tf", TRANSFORMS))
        until(lambda: place.has_listener)
        place.put(transform_message(np.zeros(3), time.time(), "map", "odom"))


def test_odometry_comes_from_the_tree_of_frames() -> None:
    with served_here(PlacedRobot(), TREE) as address:
        robot = opened(address, TREE)
        try:
            np.testing.assert_allclose(robot.observe().odometry, PLACE)
            np.testing.assert_allclose(robot.state().odometry, PLACE)
            _publish_another_part(address)
            count = robot.inbox.odometry.count
            until(lambda: robot.inbox.odometry.count > count + 2)
            assert robot.inbox.odometry.refusal is None
        finally:
            robot.close()


def test_a_transform_that_never_comes_is_named_with_those_that_do() -> None:
    asked = changed_profile(('odometry = "/odom"\n', ""), ("[driving]", "[odometry_transform]\n\n[driving]"))
    with served_here(PlacedRobot(), TREE) as address:
        said = r"/tf never came \(it has no odom to base_link, but odom to base\)"
        with pytest.raises(RobotError, match=said):
            opened(address, asked, patience_s=1.0)
