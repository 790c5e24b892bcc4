"""`ltvn robot check`: looks a robot of ROS 2 over before anybody drives it, or a recorded drive that plays one."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from tyro.conf import Positional

from ltvn_core.errors import OptionError
from ltvn_core.verbs.verb import Summary, Verb

if TYPE_CHECKING:
    from ltvn_core.importing.named_drive import NamedDrive


@dataclass(frozen=True, kw_only=True)
class RobotVerb(Verb):
    """Look a robot of ROS 2 over: rates, ages, field of view, tilt, who listens. Drives nothing without --drive.

    Ends with exit code 1 where something is not good enough to navigate by.
    """

    command: Positional[Literal["check"]]
    """What to do with it."""
    robot: Positional[str]
    """PROFILE@ADDRESS, as in turtlebot4@tcp/192.168.0.7:7447, or the path of a recorded drive, also PROFILE@PATH."""
    seconds: float = 3.0
    """How long to watch it."""
    map: Path | None = None
    """Say where in this map the robot stands, or where a recorded drive led."""
    drive: bool = False
    """Turn it on the spot a little, and measure how soon it moves and stands. Keep people and cables away."""

    def run(self) -> Summary:
        """Watch, and drive where told to; raises OptionError, DriveError, RobotError and MapError."""
        if not 0.5 <= self.seconds <= 600:
            raise OptionError(f"--seconds is from 0.5 to 600, got {self.seconds}.")
        from ltvn_core.importing.named_drive import NamedDrive

        drive = NamedDrive.find(self.robot)
        if drive is None and "@" not in self.robot:
            raise OptionError(
                f"There is no file or folder {self.robot}; name a recorded drive, or a robot as PROFILE@ADDRESS, as in "
                "turtlebot4@tcp/192.168.0.7:7447."
            )
        return self._live() if drive is None else self._recorded(drive)

    def _live(self) -> Summary:
        from ltvn_core.robots.ros2.robot_probe import look_over
        from ltvn_core.robots.ros2.ros_robot import open_ros_robot

        robot = open_ros_robot(self.robot)
        try:
            report = look_over(robot, seconds=self.seconds, drives=self.drive)
            if self.map is None:
                return report
            from ltvn_core.verbs.robot_places import place_of_robot

            return report.with_places(place_of_robot(robot, self.map))
        finally:
            robot.close()

    def _recorded(self, drive: "NamedDrive") -> Summary:
        from ltvn_core.importing.drive_check import look_over_drive

        if self.drive:
            raise OptionError(f"--drive: {self.robot} is a recorded drive, which can be watched alone.")
        report = look_over_drive(drive, seconds=self.seconds)
        if self.map is None:
            return report
        from ltvn_core.verbs.robot_places import places_of_drive

        return report.with_places(places_of_drive(drive, self.map))

    def exit_code(self, summary: Summary) -> int:
        """Return 1 where something is not good enough."""
        return int(bool(getattr(summary, "findings", ())))
