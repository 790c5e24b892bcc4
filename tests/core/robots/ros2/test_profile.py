"""A robot's profile is read strictly, and what is wrong with one is named."""

import json
import math
import re
import tomllib
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from operator import attrgetter
from pathlib import Path
from typing import Any

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
        ("radius_m = 0.178", 'radius_m = "0.2"', "expected a number, got '0.2' @ body.radius_m"),
        ("ground_clearance_m = 0.05", "ground_clearance_m = 0.9", "a body higher than its ground clearance"),
        ("radius_m = 0.178", "", "missing @ body.radius_m"),
        ("stamped = false", "stamped = 0", "expected true or false, got 0 @ driving.stamped"),
        ("guarded = false", "guardd = false", "no field guardd @ driving"),
        ('"/odom"', '"/odom/**"', "topics.odometry is '/odom/"),
        ('"/odom"', '"odom"', "topics.odometry is 'odom'"),
        ('"/cmd_vel"', '"/ltvn/cmd_vel"', "its own commands"),
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


def _numbers(part: object, place: str = "") -> Iterator[str]:
    """Yield the dotted name of each number of a profile."""
    for each in fields(part):  # type: ignore[arg-type]
        value = getattr(part, each.name)
        if is_dataclass(value):
            yield from _numbers(value, f"{place}{each.name}.")
        elif isinstance(value, int | float) and not isinstance(value, bool):
            yield place + each.name


def _toml(tables: dict[str, Any]) -> str:
    """Write tables of text and numbers."""
    lines = [
        f"{key} = {json.dumps(value) if isinstance(value, str) else str(value).lower()}"
        for key, value in tables.items()
        if not isinstance(value, dict)
    ]
    return "\n".join(
        [*lines, *(f"[{key}]\n{_toml(value)}" for key, value in tables.items() if isinstance(value, dict))]
    )


@pytest.mark.parametrize("name", tuple(_numbers(open_profile("sim"))))
def test_a_number_that_no_robot_has_is_refused_with_what_is_allowed(tmp_path: Path, name: str) -> None:
    file = tmp_path / "mine.toml"
    is_whole = isinstance(attrgetter(name)(open_profile("sim")), int)
    for wrong in (-1, 1000) if is_whole else (math.nan, math.inf, -math.inf, 1e300, -1000):
        tables = tomllib.loads(SIM)
        table, _, key = name.rpartition(".")
        (tables.setdefault(table, {}) if table else tables)[key] = wrong
        file.write_text(_toml(tables), encoding="utf-8")

        with pytest.raises(
            RobotError, match=rf"mine\.toml .*\b{re.escape(f'{name} is {wrong}')}.*; it must be from .* to "
        ):
            open_profile(str(file))


def test_an_unknown_profile_lists_the_known_ones(tmp_path: Path) -> None:
    with pytest.raises(RobotError, match="turtlebot4"):
        open_profile("turtlebot")
    with pytest.raises(RobotError, match="cannot be read"):
        open_profile(str(tmp_path / "none.toml"))
