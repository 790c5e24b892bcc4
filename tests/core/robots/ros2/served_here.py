"""A robot of a flat room served in this process, and the toolkit listening to it: a link without other processes."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from ltvn_core.errors import RobotError
from ltvn_core.robots.robot import Robot
from ltvn_core.robots.ros2.profile import RobotProfile, read_profile, shipped_profiles
from ltvn_core.robots.ros2.ros_robot import RosRobot
from ltvn_core.robots.ros2.served_robot import ServedRobot
from ltvn_core.robots.ros2.zenoh_link import ZenohLink
from tests.waiting import PATIENCE_S


def changed_profile(*changes: tuple[str, str]) -> RobotProfile:
    """The profile of the simulated robot, with other words."""
    text = shipped_profiles()["sim"].replace('truth = "/ltvn/true_pose"\n', "")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return read_profile(text, "a test")


@contextmanager
def served_here(robot: Robot, profile: RobotProfile) -> Iterator[str]:
    """Yield the address at which a robot is served."""
    over = threading.Event()
    with ZenohLink.listen("tcp/127.0.0.1:0", node="served") as link:
        served = ServedRobot(robot, link, profile)
        thread = threading.Thread(target=served.run, args=(over.is_set,))
        thread.start()
        try:
            yield link.address
        finally:
            over.set()
            thread.join(PATIENCE_S)


def opened(address: str, profile: RobotProfile, patience_s: float = 30.0) -> RosRobot:
    """The robot at an address, once it was heard. Raises RobotError."""
    link = ZenohLink.connect(address, node="ltvn")
    try:
        return RosRobot(link, profile, patience_s=patience_s)
    except RobotError:
        link.close()
        raise
