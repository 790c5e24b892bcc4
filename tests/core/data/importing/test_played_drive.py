"""A recorded bag plays a robot: its images come in recorded order and time, and commands do nothing."""

import json
import logging
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from ltvn_core.cli import main
from ltvn_core.data.importing.played_drive import NamedDrive, PlayedDrive, open_robot, play_drive
from ltvn_core.data.recording.reader import Recording
from ltvn_core.errors import DriveError, PluginError
from ltvn_core.robots.robot import WallClock
from ltvn_core.robots.robot_report import PlaceSeen, PlacesReport
from ltvn_core.robots.ros2.profile import shipped_profiles
from ltvn_core.types import Twist
from tests.core.data.importing.rosbag.bag_examples import FOCAL, bag, colours, metres, straight_drive

FRAMES = 6
FRAME_S = 0.2


class Wall:
    """A clock on the wall that a test sets."""

    now_s = 0.0

    def clock(self) -> WallClock:
        return WallClock(lambda: self.now_s, self.sleep)

    def sleep(self, duration_s: float) -> None:
        self.now_s += duration_s


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return straight_drive(tmp_path_factory.mktemp("bag") / "drive", frames=FRAMES)


@pytest.fixture
def wall() -> Wall:
    return Wall()


@pytest.fixture
def played(path: Path, wall: Wall) -> PlayedDrive:
    return play_drive(NamedDrive(path), wall.clock())


def test_images_come_in_recorded_order_and_time(played: PlayedDrive, wall: Wall) -> None:
    opened = played.observe()
    wall.now_s = 60.0  # Opening the rest took a minute.
    assert played.observe() is opened
    seen = [opened]
    for number in range(1, FRAMES):
        wall.now_s = 60.0 + FRAME_S * number - 0.01
        assert played.observe() is seen[-1]
        wall.now_s = 60.0 + FRAME_S * number + 0.01
        seen.append(played.observe())
    assert [each.stamp for each in seen] == pytest.approx([FRAME_S * number for number in range(FRAMES)])
    assert [each.odometry[0] - opened.odometry[0] for each in seen] == pytest.approx(np.arange(FRAMES) * 0.1)
    assert [float(each.require_depth("a test").max()) for each in seen] == pytest.approx(1 + 0.125 * np.arange(FRAMES))
    assert all(before.step < after.step for before, after in pairwise(seen))
    assert played.is_over
    wall.now_s = 100.0
    assert played.observe() is seen[-1]


def test_a_drive_that_waits_begins_when_it_is_told_to_and_can_be_played_again(played: PlayedDrive, wall: Wall) -> None:
    played.wait()
    first = played.observe()
    wall.now_s = 60.0
    assert played.observe() is first
    assert not played.is_over
    played.play()
    wall.now_s += FRAME_S * FRAMES
    last = played.observe()
    assert played.is_over
    played.play()
    wall.now_s += 0.01
    again = played.observe()
    assert not played.is_over
    assert np.array_equal(again.rgb, first.rgb)
    assert np.array_equal(again.odometry, first.odometry)
    assert (again.step > last.step, again.stamp > last.stamp) == (True, True)
    wall.now_s += FRAME_S * FRAMES
    assert np.array_equal(played.observe().rgb, last.rgb)
    assert played.is_over


def test_who_comes_late_sees_the_newest_image_and_where_it_was_taken(played: PlayedDrive, wall: Wall) -> None:
    first = played.observe()
    played.observe()
    wall.now_s = 0.5
    state = played.state()
    assert (state.stamp, state.odometry[0] - first.odometry[0]) == pytest.approx((0.5, 0.2))
    assert played.observe().stamp == pytest.approx(0.4)
    assert played.observe().step <= played.state().step


def test_commands_do_nothing_and_that_is_said_once(played: PlayedDrive, caplog: pytest.LogCaptureFixture) -> None:
    before = played.state().odometry
    with caplog.at_level(logging.WARNING):
        played.drive(Twist(0.0, 0.0))
        assert caplog.messages == []
        played.drive(Twist(0.5, 0.0))
        played.drive(Twist(0.5, 0.0))
        played.stop()
    assert len(caplog.messages) == 1
    assert "cannot be driven" in caplog.messages[0]
    assert np.array_equal(played.state().odometry, before)


def test_it_is_opened_by_its_path_and_has_the_camera_of_the_bag(path: Path) -> None:
    robot = open_robot(str(path))
    assert robot.spec.name == "drive (recorded)"
    assert (robot.spec.camera.fx, robot.spec.camera.height_m) == pytest.approx((FOCAL, 0.6))


def test_a_profile_says_which_topics_and_how_the_camera_sits(path: Path, tmp_path: Path) -> None:
    profile = tmp_path / "mine.toml"
    profile.write_text(
        shipped_profiles()["nav2"].replace("height_m = 0.4", "height_m = 0.9\npitch_deg = -10"), encoding="utf-8"
    )
    robot = open_robot(f"{profile}@{path}")
    assert robot.spec.radius_m == 0.25
    assert (robot.spec.camera.height_m, np.degrees(robot.spec.camera.pitch_rad)) == pytest.approx((0.9, -10))
    profile.write_text(
        profile.read_text(encoding="utf-8").replace("/camera/color/image_raw", "/front/image_raw"), encoding="utf-8"
    )
    with pytest.raises(DriveError, match=r"/front/image_raw.*/camera/color/image_raw"):
        open_robot(f"{profile}@{path}")


def test_a_file_that_is_not_there_or_no_drive_is_refused(tmp_path: Path) -> None:
    with pytest.raises(PluginError, match=r"No robot is called.*recorded drive"):
        open_robot(str(tmp_path / "gone.mcap"))
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(b"\x89MCAP0\r\n torn")
    with pytest.raises(DriveError, match="cannot be read as a bag"):
        open_robot(str(torn))


def test_a_bag_whose_lens_nobody_knows_is_left_to_the_import(tmp_path: Path) -> None:
    with bag(tmp_path / "blind") as builder:
        for number in range(3):
            builder.image("/rgb/image_raw", colours(number), "rgb8", 1.0 + number)
            builder.image("/depth/image_raw", metres(number), "32FC1", 1.0 + number)
    with pytest.raises(DriveError, match=r"lens.*ltvn import"):
        open_robot(str(tmp_path / "blind"))


def test_the_check_says_what_the_bag_shows(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["robot", "check", str(path), "--json", "-"]) == 0
    report = json.loads(capsys.readouterr().out)
    rates = {each["topic"]: each["rate_hz"] for each in report["topics"]}
    assert rates["/odom"] > rates["/camera/color/image_raw"] > 3
    assert report["image"] == "64 x 48"
    assert report["depth_share"] == 1.0
    assert report["doubts"] == []


def test_nothing_that_drives_takes_it(path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["robot", "check", str(path), "--drive"]) == 1
    assert "a recorded drive, which cannot be driven" in capsys.readouterr().err
    asked = ["evaluate-robot", str(path), "--map", "any.rrd", "--folder", str(tmp_path / "runs")]
    assert main(asked) == 1
    assert "cannot be driven" in capsys.readouterr().err


def test_the_check_of_nothing_says_what_can_be_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["robot", "check", "gone.mcap"]) == 1
    assert "There is no file or folder gone.mcap" in capsys.readouterr().err


def test_collect_records_it_to_its_end(path: Path, tmp_path: Path) -> None:
    output = tmp_path / "seen.rrd"
    assert main(["collect", "--robot", str(path), "--output", str(output)]) == 0
    recording = Recording.open(output)
    assert len(recording.frames) >= FRAMES // 2  # One every 12 cm.
    assert recording.observation(recording.frames[-1]).has_depth


def test_the_check_says_where_in_a_map_it_led(path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    drive, known = tmp_path / "drive.rrd", tmp_path / "map.rrd"
    assert main(["import", str(path), "--output", str(drive), "--json", "-"]) == 0
    assert main(["build", str(drive), "--output", str(known), "--json", "-"]) == 0
    capsys.readouterr()
    assert main(["robot", "check", str(path), "--map", str(known), "--json", "-"]) == 1
    report = json.loads(capsys.readouterr().out)
    assert len(report["places"]["images"]) == FRAMES // 2  # One every 12 cm.
    assert report["doubts"] == ["The map recognises only 0% of the images."]  # They show plain slopes of colour.


def test_the_way_through_a_map_is_said_in_a_line() -> None:
    seen = [PlaceSeen(0.1 * number, node, 0.9) for number, node in enumerate([3, 3, None, 5, 5, 3])]
    assert str(PlacesReport(tuple(seen))) == "5 of 6 images recognised, at the nodes 3 ? 5 3"
