"""`ltvn robot check`: checks a robot of ROS 2, or a recorded drive in its place, before anybody drives it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from tyro.conf import Positional

from ltvn_core.verbs.verb import Summary, Verb


@dataclass(frozen=True, kw_only=True)
class RobotVerb(Verb):
    """Check a robot of ROS 2: rates, ages, field of view, tilt and subscribers. Drives nothing without --drive.

    The exit code is 1 if the robot is not good enough for navigation.
    """

    job = "ltvn_core.verbs.jobs.robot:check_robot"

    command: Positional[Literal["check"]]
    """What to do with the robot."""
    robot: Positional[str]
    """PROFILE@ADDRESS, as in turtlebot4@tcp/192.168.0.7:7447; or a recorded drive, as its path or PROFILE@PATH."""
    seconds: float = 3.0
    """Time to watch it, in seconds."""
    map: Path | None = None
    """Map in which the robot, or each image of a recorded drive, is localised."""
    drive: bool = False
    """Turn the robot on the spot a little, and measure its delays in starting and stopping. Keep people and cables
    away."""

    def exit_code(self, summary: Summary) -> int:
        """Return 1 if the robot is not good enough for navigation."""
        return int(bool(getattr(summary, "findings", ())))
