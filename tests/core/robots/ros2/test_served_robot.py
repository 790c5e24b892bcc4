"""The simulated robot, served by a process of its own, is a robot of ROS 2: for the toolkit, and for another maker."""

import json
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import numpy as np
import pytest
from zenoh_ros2_sdk import ROS2Publisher, ROS2Subscriber, get_registry, get_topic_names_and_types
from zenoh_ros2_sdk.utils import get_type_hash, load_dependencies_recursive

from ltvn_core.cli import run_verb
from ltvn_core.errors import RobotError
from ltvn_core.geometry import wrap_angle
from ltvn_core.robots.robot_plugins import open_robot
from ltvn_core.robots.robot_view import ContinuedRobot, watch_drive
from ltvn_core.robots.ros2.profile import shipped_profiles
from ltvn_core.robots.ros2.ros_cameras import CAMERA_INFO
from ltvn_core.robots.ros2.ros_images import COMPRESSED_IMAGE, IMAGE
from ltvn_core.robots.ros2.ros_messages import read_odometry, twist_message
from ltvn_core.robots.ros2.ros_robot import RosRobot, open_ros_robot
from ltvn_core.robots.ros2.topic_keys import BUMPER, ODOMETRY, TRANSFORMS, TWIST, type_hash
from ltvn_core.types import Twist
from ltvn_core.verbs.robot import RobotVerb
from tests.core.robots.ros2.other_maker import other_makers_session, write_definitions
from tests.core.robots.ros2.processes import free_address, serving
from tests.waiting import PATIENCE_S, until

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    place = free_address()
    with serving(place):
        yield place


@pytest.fixture
def robot(address: str) -> Iterator[RosRobot]:
    with closing(open_ros_robot(f"sim@{address}", patience_s=60.0)) as opened:
        yield opened


def test_the_toolkit_sees_and_drives_it(address: str) -> None:
    robot = open_robot(f"sim@{address}")
    assert isinstance(robot, RosRobot)
    try:
        first = robot.observe()
        assert first.has_depth
        assert robot.spec.camera.horizontal_fov_rad == pytest.approx(1.211, abs=1e-3)

        def turned() -> bool:
            robot.drive(Twist(0.0, 0.8))
            return abs(robot.state().odometry[2] - first.odometry[2]) > 0.1

        until(turned, meanwhile=lambda: robot.clock.advance(0.05))
        robot.stop()
        later = robot.observe()

        assert later.step > first.step
        assert later.stamp > first.stamp
    finally:
        robot.close()


def test_it_stands_when_commands_stop_coming(robot: RosRobot) -> None:
    robot.drive(Twist(0.0, 0.8))
    standing = [robot.state()]

    def stands() -> bool:
        standing.append(robot.state())
        window = [each.odometry for each in standing if each.stamp > standing[-1].stamp - 0.35]
        return len({each.stamp for each in standing}) > 6 and np.ptp(np.array(window), axis=0).max() < 1e-6

    until(stands)


def test_another_maker_lists_its_topics_reads_its_images_and_drives_it(address: str, tmp_path: Path) -> None:
    images, places = SimpleQueue[Any](), SimpleQueue[Any]()
    with other_makers_session(address, tmp_path) as port:
        topics = dict(get_topic_names_and_types(router_port=port, timeout=10))
        seen = ROS2Subscriber("/camera/color/image_raw", IMAGE, images.put, router_port=port)
        felt = ROS2Subscriber("/odom", ODOMETRY, places.put, router_port=port)
        wheels = ROS2Publisher("/cmd_vel", TWIST, router_port=port)
        try:
            image, first = images.get(timeout=PATIENCE_S), places.get(timeout=PATIENCE_S)
            until(lambda: _turn(wheels) or abs(_heading(places.get(timeout=PATIENCE_S)) - _heading(first)) > 0.1)
        finally:
            for each in (seen, felt, wheels):
                each.close()

    assert topics["/odom"] == [ODOMETRY]
    assert topics["/cmd_vel"] == [TWIST]
    assert {"/camera/color/image_raw", "/camera/color/camera_info"} <= topics.keys()
    assert (image.width, image.height, image.encoding) == (96, 72, "rgb8")
    assert np.ptp(image.data) > 50


@pytest.mark.parametrize("name", [TWIST, IMAGE, COMPRESSED_IMAGE, ODOMETRY, CAMERA_INFO, TRANSFORMS, BUMPER])
def test_another_maker_computes_the_same_hashes(tmp_path: Path, name: str) -> None:
    write_definitions(tmp_path)
    get_registry().messages_dir = tmp_path
    text = (tmp_path / f"{name}.msg").read_text(encoding="utf-8")

    assert type_hash(name) == get_type_hash(name, text, load_dependencies_recursive(name, text, get_registry()))


def _turn(wheels: ROS2Publisher) -> None:
    still = twist_message(Twist(0.0, 0.8), None)
    wheels.publish(linear=still.linear, angular=still.angular)


def _heading(message: Any) -> float:
    return float(read_odometry(message, "/odom")[2])


def test_a_robot_that_is_not_there_is_an_error_that_says_what_to_do() -> None:
    with pytest.raises(RobotError, match=r"No router answers at tcp/127\.0\.0\.1:1"):
        open_robot("sim@tcp/127.0.0.1:1")
    with pytest.raises(RobotError, match="write tcp/HOST:PORT"):
        open_robot("sim@127.0.0.1")
    with pytest.raises(RobotError, match="Did you mean sim"):
        open_robot("simm@tcp/127.0.0.1:1")


def test_topics_that_nobody_publishes_are_named(address: str, tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(shipped_profiles()["sim"].replace('"/odom"', '"/odometry"'), encoding="utf-8")

    with pytest.raises(RobotError, match="/odometry never came"):
        open_ros_robot(f"{file}@{address}", patience_s=1.0)


def test_a_check_measures_it_and_drives_only_when_told_to(address: str, capsys: pytest.CaptureFixture[str]) -> None:
    place = f"sim@{address}"

    def check(*options: str) -> dict[str, Any]:
        failed = run_verb("ltvn robot", RobotVerb, ["check", place, "--seconds", "1", "--json", "-", *options])
        told = json.loads(capsys.readouterr().out)
        # On a busy machine images are late, which the check rightly says.
        assert failed == bool(told["doubts"])
        return told

    looked = check()
    driven = check("--drive")

    assert looked["driving"] is None
    assert looked["field_of_view_deg"][0] == pytest.approx(69.4, abs=0.1)
    assert [each["publishers"] for each in looked["topics"]] == [["ltvn_simulator"]] * 3
    assert all(0 < each["rate_hz"] < 15 for each in looked["topics"])
    assert driven["driving"]["moves_after_s"] > 0
    assert driven["driving"]["stands_after_s"] > 0


def test_images_of_a_drive_are_those_at_which_it_moved_and_go_on_from_a_map(robot: RosRobot) -> None:
    continued = ContinuedRobot(robot, last_step=5000, last_stamp_s=900.0)
    begin = continued.state().odometry[2]

    def is_over() -> bool:
        continued.drive(Twist(0.0, 0.8))
        return abs(float(wrap_angle(continued.state().odometry[2] - begin))) > 0.8

    images = list(watch_drive(continued, is_over))

    steps = [image.step for image in images]
    assert 2 <= len(images) <= 6
    assert steps == sorted(set(steps))
    assert steps[0] > 5000
    assert images[0].stamp > 900.0
