"""Robots of other people are found by name or in a file, and whatever is wrong with one is said at the door."""

import re
import subprocess
import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest

from ltvn_core.errors import PluginError
from ltvn_core.plugins import ROBOTS, find_plugins
from ltvn_core.robots.robot_plugins import open_robot
from ltvn_core.types import Twist
from tests.repository import ROOT
from tests.waiting import until

ROBOT = """
from tests.core.flat_world import FlatRobot, one_room

def make_robot():
    return FlatRobot(one_room(), (1.0, 1.0, 0.0))

class NoSpec:
    pass

def blind():
    robot = make_robot()
    robot.observe = lambda: None
    return robot

def legless():
    robot = make_robot()
    robot.drive = None
    return robot

def timeless():
    robot = make_robot()
    robot.clock = None
    return robot

def lost():
    robot = make_robot()
    robot.state = lambda: FlatRobot.state(robot)._replace(odometry=(float("nan"), 0, 0))
    return robot

def unplugged():
    robot = make_robot()
    robot.observe = broken
    return robot

def wordless():
    robot = make_robot()
    robot.state = broken
    return robot

def wrong_state():
    robot = make_robot()
    robot.state = lambda: (0, 0, 0)
    return robot

def worded():
    robot = make_robot()
    robot.state = lambda: FlatRobot.state(robot)._replace(stamp="noon")
    return robot

def unmade():
    return FlatRobot

def nothing():
    pass

def broken():
    raise OSError("no cable")

number = 3
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "my_robot.py"
    path.write_text(ROBOT, encoding="utf-8")
    return path


def test_a_robot_in_a_file_is_made_by_its_function(file: Path) -> None:
    assert open_robot(f"{file}:make_robot").spec.name == "LoCoBot"


def test_an_installed_robot_is_found_by_its_name() -> None:
    entries = find_plugins(
        ROBOTS, entries=[EntryPoint("mine", "tests.core.robots.test_robot_plugins:a_robot", ROBOTS.name)]
    )
    assert open_robot("mine", entries).spec.name == "LoCoBot"


@pytest.mark.parametrize(
    ("factory", "said"),
    [
        ("gone", r"no function 'gone'. It has: FlatRobot, NoSpec, blind"),
        ("number", "cannot be called"),
        ("broken", "OSError: no cable"),
        ("NoSpec", "give it a ltvn_core.RobotSpec"),
        ("unmade", "robot"),
        ("nothing", "is None with the `spec` None"),
        ("timeless", "has no `clock`"),
        ("legless", "lacks drive"),
        ("blind", r"observe\(\) must return a ltvn_core.Observation, got None"),
        ("unplugged", r"failed in observe\(\) \(OSError: no cable\)"),
        ("wordless", r"failed in state\(\) \(OSError: no cable\)"),
        ("wrong_state", r"state\(\) must return a ltvn_core.RobotState, got \(0, 0, 0\)"),
        ("worded", "all finite"),
        ("lost", "all finite"),
    ],
)
def test_what_is_wrong_with_a_robot_is_said_before_the_page_opens(file: Path, factory: str, said: str) -> None:
    with pytest.raises(PluginError, match=said):
        open_robot(f"{file}:{factory}")


@pytest.mark.parametrize(
    ("wanted", "said"),
    [
        ("nowhere.py:make_robot", "nowhere.py does not exist"),
        ("nowhere.py", "does not name a robot"),
        ("nobody", "No robot is called 'nobody'. Installed robots: none"),
    ],
)
def test_a_robot_that_is_not_there_is_refused_with_what_would_be_valid(wanted: str, said: str) -> None:
    with pytest.raises(PluginError, match=said):
        open_robot(wanted, {})


def test_a_file_that_cannot_be_run_is_named(tmp_path: Path) -> None:
    path = tmp_path / "torn.py"
    path.write_text("import nothing_of_this_name", encoding="utf-8")
    with pytest.raises(PluginError, match=r"torn\.py could not be run"):
        open_robot(f"{path}:make_robot")


@pytest.fixture
def documented(tmp_path: Path) -> tuple[Path, list[str]]:
    """The robot that the guide prints, in a file, and the commands that it prints for it."""
    page = (ROOT / "docs" / "how-to" / "own-robot.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    path = tmp_path / "my_robot.py"
    path.write_text(code, encoding="utf-8")
    return path, re.findall(r"^\$ ltvn (.*?)(?: *#.*)?$", page, re.MULTILINE)


def test_the_robot_of_the_guide_drives_as_printed_and_stops_by_itself(documented: tuple[Path, list[str]]) -> None:
    robot = open_robot(f"{documented[0]}:make_robot")
    until(lambda: robot.drive(Twist(0.3, 0.5)) or robot.state().odometry[0] > 0.05)
    assert robot.state().odometry[2] > 0.05

    until(lambda: np.array_equal(robot.state().odometry, robot.state().odometry))
    assert robot.observe().has_depth


@pytest.mark.slow
def test_the_guides_command_records_the_guides_robot(documented: tuple[Path, list[str]]) -> None:
    path, (collect, app) = documented
    assert app == "app --robot my_robot.py:make_robot"
    command = [sys.executable, "-m", "ltvn_core.cli", *collect.split()]
    done = subprocess.run(command, cwd=path.parent, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert (path.parent / "first.rrd").stat().st_size > 10_000


def a_robot() -> object:
    from tests.core.flat_world import FlatRobot, one_room

    return FlatRobot(one_room(), (1.0, 1.0, 0.0))
