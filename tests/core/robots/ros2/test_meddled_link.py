"""A link that holds messages up, loses or changes them: a clear word, and no motion that nobody asked for."""

import re
from collections.abc import Iterator
from contextlib import suppress

import numpy as np
import pytest

from ltvn_core.errors import RobotError
from ltvn_core.robots.link_report import LinkQuality
from ltvn_core.robots.ros2.ros_images import IMAGE
from ltvn_core.robots.ros2.ros_messages import image_message
from ltvn_core.robots.ros2.ros_robot import RosRobot, open_ros_robot
from ltvn_core.robots.ros2.topic_keys import Topic
from ltvn_core.types import ZERO_TWIST, Twist
from tests.core.robots.ros2.meddled_link import Meddle, MeddledRobot, Parcel, leave_alone, meddled_robot
from tests.waiting import until

AHEAD = Twist(0.2, 0.0)
COLOUR = "/camera/color/image_raw"


@pytest.fixture
def body() -> Iterator[MeddledRobot]:
    with meddled_robot() as robot:
        yield robot


@pytest.fixture
def robot(body: MeddledRobot) -> Iterator[RosRobot]:
    opened = open_ros_robot(f"sim@{body.link.address}", patience_s=60.0)
    yield opened
    opened.close()


def late_by(seconds: float) -> Meddle:
    return lambda parcel: [(seconds, parcel)]


def other_edition(parcel: Parcel) -> list[tuple[float, Parcel]]:
    return [(0.0, parcel._replace(key=parcel.key[:-1] + "0"))]


def cut(parcel: Parcel) -> list[tuple[float, Parcel]]:
    return [(0.0, parcel._replace(payload=parcel.payload[:20]))]


def foreign_attachment(parcel: Parcel) -> list[tuple[float, Parcel]]:
    return [(0.0, parcel._replace(attachment=parcel.attachment[:-1]))]


def lost(parcel: Parcel) -> list[tuple[float, Parcel]]:
    return []


def drive_like_a_person(robot: RosRobot) -> str:
    """Hold a key, look, and return what was wrong."""
    robot.drive(AHEAD)
    try:
        robot.observe()
    except RobotError as error:
        return str(error)
    return ""


def set_out(robot: RosRobot, body: MeddledRobot) -> None:
    until(lambda: drive_like_a_person(robot) == "" and body.moves)


def let_go(robot: RosRobot) -> None:
    until(lambda: _sees(robot))


def _sees(robot: RosRobot) -> bool:
    with suppress(RobotError):
        robot.observe()
        return True
    return False


@pytest.mark.parametrize(
    ("meddle", "words"),
    [
        (lost, "its newest image is"),
        (late_by(1.5), "late; it is not used"),
        (other_edition, "another version"),
        (cut, "is the message cut"),
        (foreign_attachment, "not the 33 bytes of rmw_zenoh"),
    ],
)
def test_what_cannot_be_used_stops_the_robot_says_why_and_driving_does_not_come_back(
    body: MeddledRobot, robot: RosRobot, meddle: Meddle, words: str
) -> None:
    set_out(robot, body)

    body.meddle = meddle
    said: list[str] = []
    until(
        lambda: said.append(drive_like_a_person(robot)) or re.search(words, said[-1], re.IGNORECASE),
        explain=lambda: said[-1],
    )
    until(lambda: drive_like_a_person(robot) and not body.moves)
    stood = len(body.told)
    body.meddle = leave_alone
    until(lambda: drive_like_a_person(robot) and robot.link_report().picture_age_s < 0.2)
    assert AHEAD not in body.told[stood:]
    assert "Release" in drive_like_a_person(robot)

    let_go(robot)
    assert AHEAD not in body.told[stood:]
    set_out(robot, body)


def test_lost_and_reordered_messages_are_counted_and_never_used_out_of_order(
    body: MeddledRobot, robot: RosRobot
) -> None:
    moments: dict[bytes, int] = {}

    def shuffle(parcel: Parcel) -> list[tuple[float, Parcel]]:
        # Whole moments of four messages are lost, or overtaken. Each message begins with its stamp.
        moment = moments.setdefault(parcel.payload[4:12], len(moments))
        return [[], [(0.0, parcel)], [(0.12, parcel)]][moment % 3]

    body.meddle = shuffle
    stamps: list[float] = []

    def looked_often() -> bool:
        with suppress(RobotError):
            stamps.append(robot.observe().stamp)
        return len(set(stamps)) > 8

    until(looked_often)
    until(lambda: robot.link_report().quality is LinkQuality.WEAK)
    assert stamps == sorted(stamps)
    assert robot.link_report().lost_share > 0.2


@pytest.mark.parametrize("ahead_s", [3600.0, -3600.0])
def test_a_clock_that_is_set_stops_the_robot_and_our_time_goes_on(
    body: MeddledRobot, robot: RosRobot, ahead_s: float
) -> None:
    set_out(robot, body)
    before = robot.observe()

    body.stamps_ahead_s = ahead_s
    said: list[str] = []
    until(lambda: said.append(drive_like_a_person(robot)) or "stamps jumped" in said[-1])
    until(lambda: drive_like_a_person(robot) and not body.moves)
    let_go(robot)

    after = robot.observe()
    assert before.stamp < after.stamp < before.stamp + 600
    assert before.step < after.step < before.step + 6000


def test_a_second_robot_on_the_same_topic_is_told_and_not_seen(body: MeddledRobot, robot: RosRobot) -> None:
    other = body.link.publisher(Topic(COLOUR, IMAGE))
    white = np.full((12, 16, 3), 255, np.uint8)

    def told() -> bool:
        other.put(image_message(white, 5.0))
        assert robot.observe().rgb.max() == 80
        return "two senders at once" in (robot.inbox.colour.refusal or "")

    until(told)
    assert AHEAD not in body.told


def test_depth_that_is_no_number_is_no_depth(body: MeddledRobot, robot: RosRobot) -> None:
    assert robot.observe().has_depth
    body.depth = np.full((12, 16), np.nan, np.float32)

    until(lambda: not robot.observe().has_depth)
    assert set(body.told) == {ZERO_TWIST}
