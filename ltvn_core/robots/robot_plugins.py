"""Robots from other packages: found by name among installed packages, or in a Python file.

A package provides robots in the entry-point group `ltvn.robots`; an entry is `name = "package.module:factory"`, and
the factory returns a `ltvn_core.robots.robot.Robot` when it is called without arguments. A file is named as
`path/to/file.py:factory`, and a robot of ROS 2 as PROFILE@ADDRESS. Owns the check that such a robot can
be driven. Drives nothing.
"""

import math
import sys
from collections.abc import Callable, Mapping
from functools import partial
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any, cast

from ltvn_core.errors import ImageError, LtvnError, PluginError
from ltvn_core.extras import naming_the_extra
from ltvn_core.plugins import ROBOTS, Plugin, find_plugins
from ltvn_core.preprocessing import admit_observation
from ltvn_core.robots.robot import Robot
from ltvn_core.robots.robot_spec import RobotSpec
from ltvn_core.types import Observation, RobotState

METHODS = ("observe", "state", "drive", "stop")
HOW_TO = (
    "`--robot NAME` opens an installed robot, `--robot path/to/file.py:factory` one from a Python file, `--robot "
    "turtlebot4@tcp/HOST:7447` a ROS 2 robot with its profile, and `--robot drive.mcap` plays an existing recorded "
    "drive"
)


def open_robot(wanted: str, installed: Mapping[str, Plugin] | None = None) -> Robot:
    """Create the robot with that name, from `path/to/file.py:factory`, or at PROFILE@ADDRESS (ROS 2), and check it.

    Takes one image; drives nothing. Raises PluginError if there is no such robot, if its factory fails, or if it lacks
    a part, and RobotError if a robot of ROS 2 cannot be reached.
    """
    if "@" in wanted:
        with naming_the_extra():
            from ltvn_core.robots.ros2.ros_robot import open_ros_robot
        factory = partial(open_ros_robot, wanted)
    else:
        factory = _function_in_file(wanted) if ".py" in wanted else _installed(wanted, installed)
        if not callable(factory):
            raise PluginError(
                f"{wanted} is {factory!r}, which cannot be called; name a function that creates the robot."
            )
    try:
        robot = factory()
    except LtvnError:
        raise
    except Exception as error:  # Another person's code may raise anything.
        raise PluginError(f"The robot {wanted} could not be created ({type(error).__name__}: {error}).") from error
    check_robot(robot, wanted)
    return cast(Robot, robot)


def check_robot(robot: object, name: str) -> None:
    """Raise PluginError if a part of a robot is missing, or if its first image does not fit its camera."""
    parts = {part: _answer(name, part, partial(getattr, robot, part, None)) for part in ("spec", "clock", *METHODS)}
    spec, clock = parts["spec"], parts["clock"]
    if not isinstance(spec, RobotSpec):
        raise PluginError(
            f"The robot {name} is {robot!r:.60} with the `spec` {spec!r:.60}; give it a ltvn_core.RobotSpec, see "
            "examples/05_drive_your_own_robot.py."
        )
    if not (isinstance(getattr(clock, "is_simulated", None), bool) and callable(getattr(clock, "now", None))):
        raise PluginError(f"The robot {name} has no `clock`; give it a ltvn_core.WallClock(), got {clock!r}.")
    missing = [method for method in METHODS if not callable(parts[method])]
    if missing:
        raise PluginError(
            f"The robot {name} lacks {', '.join(missing)}; a robot has spec, clock, {', '.join(METHODS)}, see "
            "ltvn_core.Robot and examples/05_drive_your_own_robot.py."
        )
    seen = _answer(name, "observe()", parts["observe"], Observation)
    try:
        admit_observation(seen, spec.camera, spec.camera, source=name)
    except ImageError as error:
        raise PluginError(f"The robot {name} returns images that cannot be used: {error}") from error
    state = _answer(name, "state()", parts["state"], RobotState)
    try:
        sound = len(state.odometry) == 3 and all(map(math.isfinite, [*state.odometry, state.stamp]))
    except TypeError:  # Not numbers.
        sound = False
    if not sound:
        raise PluginError(f"The robot {name}: its state must have x, y, yaw and seconds, all finite, got {state}.")


def _answer(name: str, part: str, ask: Callable[[], Any], kind: type | None = None) -> Any:
    """Return what a part of a robot answers. Raises PluginError if it fails, or is not of the kind that it must be."""
    try:
        answer = ask()
    except Exception as error:  # Another person's code may raise anything.
        raise PluginError(f"The robot {name} failed in {part} ({type(error).__name__}: {error}).") from error
    if kind is not None and not isinstance(answer, kind):
        raise PluginError(f"The robot {name}: {part} must return a ltvn_core.{kind.__name__}, got {answer!r:.60}.")
    return answer


def _installed(name: str, installed: Mapping[str, Plugin] | None) -> object:
    robots = find_plugins(ROBOTS) if installed is None else installed
    if name not in robots:
        names = ", ".join(robots) or "none"
        raise PluginError(f"No robot is called {name!r}. Installed robots: {names}. {HOW_TO}.")
    return robots[name].load()


def _function_in_file(wanted: str) -> object:
    place, _, name = wanted.rpartition(":")
    path = Path(place)
    if not place.endswith(".py") or not name.isidentifier():
        raise PluginError(
            f"{wanted} does not name a robot; write the file and the function, as in my_robot.py:make_robot."
        )
    if not path.is_file():
        raise PluginError(f"{path} does not exist. {HOW_TO}.")
    spec = spec_from_file_location(f"ltvn_robot_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise PluginError(f"{path} is not a Python file. {HOW_TO}.")
    module = module_from_spec(spec)
    sys.modules[spec.name] = module  # Dataclasses look up their module while it is executed.
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise PluginError(f"{path} could not be run ({type(error).__name__}: {error}).") from error
    offered = sorted(key for key, value in vars(module).items() if callable(value) and not key.startswith("_"))
    if not hasattr(module, name):
        raise PluginError(f"{path} has no function {name!r}. It has: {', '.join(offered) or 'none'}.")
    return getattr(module, name)
