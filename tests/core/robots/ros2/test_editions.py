"""Robots of each edition of ROS 2 are seen and driven alike, and a profile that does not fit one is corrected in words.

The robots are stand-ins; no program of ROS takes part.
"""

import logging
import time
from collections.abc import Iterator
from contextlib import closing
from queue import Empty, SimpleQueue
from typing import Any, TypeVar

import numpy as np
import pytest

from ltvn_core.errors import RobotError
from ltvn_core.robots.ros2.guard import Guard
from ltvn_core.robots.ros2.profile import RobotProfile
from ltvn_core.robots.ros2.robot_probe import look_over
from ltvn_core.robots.ros2.ros_messages import twist_message
from ltvn_core.robots.ros2.ros_robot import RosRobot
from ltvn_core.robots.ros2.topic_keys import TWIST, TWIST_STAMPED, Topic
from ltvn_core.robots.ros2.zenoh_link import TopicPublisher, ZenohLink
from ltvn_core.types import ZERO_TWIST, Twist
from tests.core.robots.ros2.edition_robots import (
    COLOUR,
    DEPTH_M,
    EARLY_JAZZY,
    HUMBLE,
    JAZZY,
    KILTED,
    POSE,
    Edition,
    EditionRobot,
)
from tests.core.robots.ros2.served_here import changed_profile, opened
from tests.waiting import PATIENCE_S, until

T = TypeVar("T")
TURN = Twist(0.0, 0.5)
SOON_S = 1.0

each_edition = pytest.mark.parametrize("edition", [HUMBLE, JAZZY, KILTED], ids=lambda edition: edition.name)
each_type = pytest.mark.parametrize("stamped", [False, True], ids=["Twist", "TwistStamped"])


@pytest.fixture
def base() -> Iterator[ZenohLink]:
    with ZenohLink.listen("tcp/127.0.0.1:0", node="base") as link:
        yield link


@pytest.fixture
def driver(base: ZenohLink) -> Iterator[ZenohLink]:
    with ZenohLink.connect(base.address, node="driver") as link:
        yield link


def commands_of(driver: ZenohLink, *, stamped: bool) -> TopicPublisher:
    return driver.command_publisher(Topic("/cmd_vel", TWIST_STAMPED if stamped else TWIST))


def look(robot: RosRobot) -> tuple[str, ...]:
    return look_over(robot, seconds=0.5, drives=False).doubts


def profile_of(*, stamped: bool) -> RobotProfile:
    bumper = ('bumper = "/bumper"\n', "")
    return changed_profile(bumper, ("stamped = false", "stamped = true")) if stamped else changed_profile(bumper)


@each_edition
@each_type
def test_commands_reach_it_once_and_its_coming_and_going_are_seen(
    base: ZenohLink, driver: ZenohLink, edition: Edition, stamped: bool
) -> None:
    commands = commands_of(driver, stamped=stamped)
    assert not commands.has_listener
    robot = EditionRobot(base, edition, stamped=stamped)
    until(lambda: commands.has_listener)

    message = twist_message(TURN, 1.0 if stamped else None)
    assert _delivered(commands, robot.reached, message, times=3) == [(TURN, 1), (TURN, 2), (TURN, 3)]
    with pytest.raises(Empty):
        robot.reached.get(timeout=0.2)
    robot.close()
    until(lambda: not commands.has_listener)


@each_edition
def test_one_that_was_there_before_is_found(base: ZenohLink, driver: ZenohLink, edition: Edition) -> None:
    EditionRobot(base, edition)
    commands = commands_of(driver, stamped=edition.stamped)

    until(lambda: commands.has_listener)


def _delivered(commands: TopicPublisher, reached: SimpleQueue[T], message: Any, times: int) -> list[T]:
    """Send a message several times, each once the one before has arrived: a link that is full drops what comes next."""
    arrived = []
    for _ in range(times):
        commands.put(message)
        arrived.append(reached.get(timeout=PATIENCE_S))
    return arrived


@each_edition
def test_what_it_sees_and_where_it_is_are_heard_and_its_check_finds_nothing(base: ZenohLink, edition: Edition) -> None:
    profile = profile_of(stamped=edition.stamped)
    with EditionRobot(base, edition).looking(), closing(opened(base.address, profile)) as robot:
        seen = robot.observe()
        doubts = look(robot)

    np.testing.assert_allclose(seen.odometry, POSE)
    assert (seen.rgb == COLOUR).all()
    np.testing.assert_allclose(seen.require_depth("a test"), DEPTH_M)
    assert not [doubt for doubt in doubts if "profile" in doubt or "listens" in doubt]


def _drive_off(driver: ZenohLink, profile: RobotProfile) -> None:
    stamped = profile.driving.stamped
    commands = driver.publisher(Topic(profile.driving.guard_topic, TWIST_STAMPED if stamped else TWIST))
    until(lambda: commands.has_listener)
    for twist in (ZERO_TWIST, TURN):
        commands.put(twist_message(twist, time.time() if stamped else None))


@pytest.mark.parametrize(("edition", "stamped"), [(HUMBLE, False), (JAZZY, True), (KILTED, True)])
def test_the_guard_forwards_to_it(base: ZenohLink, driver: ZenohLink, edition: Edition, stamped: bool) -> None:
    robot = EditionRobot(base, edition, stamped=stamped)
    guard = Guard(base, profile_of(stamped=stamped))
    until(lambda: guard.has_listener)

    _drive_off(driver, profile_of(stamped=stamped))

    assert robot.reached.get(timeout=PATIENCE_S)[0] == ZERO_TWIST


def test_the_guard_says_soon_that_nobody_takes_its_commands(
    base: ZenohLink, driver: ZenohLink, caplog: pytest.LogCaptureFixture
) -> None:
    profile = profile_of(stamped=False)
    guard = Guard(base, profile)
    with caplog.at_level(logging.WARNING):
        _drive_off(driver, profile)
        until(lambda: guard.forwarded > 0)
        until(lambda: "No node subscribes" in caplog.text, patience_s=SOON_S)


@pytest.mark.parametrize(("edition", "stamped"), [(HUMBLE, False), (JAZZY, False), (KILTED, True)])
def test_the_guard_says_soon_that_the_robot_expects_the_other_type(
    base: ZenohLink, driver: ZenohLink, caplog: pytest.LogCaptureFixture, edition: Edition, stamped: bool
) -> None:
    profile = profile_of(stamped=not stamped)
    EditionRobot(base, edition, stamped=stamped)
    guard = Guard(base, profile)
    with caplog.at_level(logging.WARNING):
        _drive_off(driver, profile)
        until(lambda: guard.forwarded > 0)
        until(lambda: "No node subscribes" in caplog.text and "driving.stamped" in caplog.text, patience_s=SOON_S)


def test_an_early_jazzy_is_asked_to_update(base: ZenohLink) -> None:
    with EditionRobot(base, EARLY_JAZZY).looking():

        def is_asked() -> bool:
            with pytest.raises(RobotError) as refused:
                opened(base.address, profile_of(stamped=False), patience_s=0.3)
            return "0.2.4 or newer" in str(refused.value)

        until(is_asked)
