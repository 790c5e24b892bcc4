"""A robot's profile is read strictly, and what is wrong with one is named."""

from pathlib import Path

import pytest

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.errors import RobotError
from ltvn_core.robots.ros2.profile import open_profile, shipped_profiles

SIM = shipped_profiles()["sim"]


@pytest.mark.parametrize("name", ["locobot", "nav2", "sim", "stretch", "turtlebot4"])
def test_a_shipped_profile_makes_a_robot(name: str) -> None:
    spec = open_profile(name).spec(CameraModel.from_fov(640, 480, 1.2))

    assert spec.camera.height_m > 0.2
    assert spec.camera.width == 640
    assert spec.radius_m > 0.1


def test_a_profile_of_ones_own_is_named_by_its_path(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(
        SIM.replace("0.178", "0.3").replace("height_m = 0.6", "height_m = 0.6\npitch_deg = -20"), encoding="utf-8"
    )

    profile = open_profile(str(file))

    assert profile.body.radius_m == 0.3
    assert profile.mounted(CameraModel.from_fov(64, 48, 1.0)).pitch_rad == pytest.approx(-0.349, abs=1e-3)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("radius_m = 0.178", "radius_m = -1", "radius above 0 m"),
        ("radius_m = 0.178", 'radius_m = "0.2"', "expected a finite number, got '0.2' @ body.radius_m"),
        ("radius_m = 0.178", "radius_m = nan", "expected a finite number, got nan @ body.radius_m"),
        ("radius_m = 0.178", "", "missing @ body.radius_m"),
        ("stamped = false", "stamped = 0", "expected true or false, got 0 @ driving.stamped"),
        ("guarded = false", "guardd = false", "no field guardd @ driving"),
        ('"/odom"', '"/odom/**"', "topics.odometry is '/odom/"),
        ('"/odom"', '"odom"', "topics.odometry is 'odom'"),
        ('"/cmd_vel"', '"/ltvn/cmd_vel"', "its own commands"),
        ("height_m = 0.6", "height_m = 0.6\nquarter_turns = 5", "quarter_turns must be"),
        ("height_m = 0.6", "height_m = 0.6\n[speeds]\nlinear_m_s = 0", "linear_m_s is 0"),
        ("height_m = 0.6", "height_m = 0.6\n[speeds]\nturning_radius_m = -1", "turning_radius_m is -1"),
        ("[topics]", "domain = 500\n[topics]", "ROS_DOMAIN_ID must be from 0 to 232"),
        ('odometry = "/odom"', "", "either topics.odometry or the table odometry_transform"),
        ("[topics]", "[odometry_transform]\n[topics]", "not both"),
        ("[topics]", "[odometry_transform]\nchild = 'odom'\n[topics]", "has odom as both parent and child"),
        ("[topics]", "[odometry_transform]\nparent = '*'\n[topics]", "write a frame like base_link"),
        ("[topics]", "[topics", "is not TOML"),
        ("[topics]", f"deep = {'[' * 900}{']' * 900}\n[topics]", "levels deep"),
    ],
)
def test_what_is_wrong_with_a_profile_is_named(tmp_path: Path, old: str, new: str, message: str) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(SIM.replace(old, new, 1), encoding="utf-8")

    with pytest.raises(RobotError) as caught:
        open_profile(str(file))

    assert message in str(caught.value)
    assert "mine.toml" in str(caught.value)


def test_an_unknown_profile_lists_the_known_ones(tmp_path: Path) -> None:
    with pytest.raises(RobotError, match="turtlebot4"):
        open_profile("turtlebot")
    with pytest.raises(RobotError, match="cannot be read"):
        open_profile(str(tmp_path / "none.toml"))
