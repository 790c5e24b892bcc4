"""`ltvn robot check`: looks a robot of ROS 2 over before anybody drives it, or a recorded drive that plays one."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from tyro.conf import Positional

from ltvn_core.verbs.verb import Summary, Verb


@dataclass(frozen=True, kw_only=True)
class RobotVerb(Verb):
    """Look a robot of ROS 2 over: rates, ages, field of view, tilt, who listens. Drives nothing without --drive.

    Ends with exit code 1 where something is not good enough to navigate by.
    """

    job = "ltvn_core.verbs.jobs.robot:check_robot"

    command: Positional[Literal["check"]]
    """Action on the robot."""
    robot: Positional[str]
    """PROFILE@ADDRESS, as in turtlebot4@tcp/192.168.0.7:7447, or the path of a recorded drive, also PROFILE@PATH."""
    seconds: float = 3.0
    """Time to watch it, in seconds."""
    map: Path | None = None
    """Say where in this map the robot stands, or where a recorded drive led."""
    drive: bool = False
    """Turn it on the spot a little, and measure how soon it moves and stands. Keep people and cables away."""

    def exit_code(self, summary: Summary) -> int:
        """Return 1 where something is not good enough."""
        return int(bool(getattr(summary, "findings", ())))
