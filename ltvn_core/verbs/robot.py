"""`ltvn robot check`: checks a robot of ROS 2, or a recorded drive in its place, before anybody drives it."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from tyro.conf import Positional

from ltvn_core.errors import MapError, OptionError
from ltvn_core.verbs.verb import Summary, Verb

if TYPE_CHECKING:
    from ltvn_core.data.importing.played_drive import NamedDrive
    from ltvn_core.maps.topological_map import TopologicalMap
    from ltvn_core.robots.robot import Robot
    from ltvn_core.robots.robot_report import PlacesReport
    from ltvn_core.types import Observation


@dataclass(frozen=True, kw_only=True)
class RobotVerb(Verb):
    """Check a robot of ROS 2: rates, ages, field of view, tilt and subscribers. Drives nothing without --drive.

    The exit code is 1 if the robot is not good enough for navigation.
    """

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

    def run(self) -> Summary:
        """Watch a robot, and drive it if requested; raises OptionError, DriveError, RobotError and MapError."""
        from ltvn_core.data.importing.played_drive import NamedDrive

        if not 0.5 <= self.seconds <= 600:
            raise OptionError(f"--seconds must be from 0.5 to 600, got {self.seconds}.")
        drive = NamedDrive.find(self.robot)
        if drive is None and "@" not in self.robot:
            raise OptionError(
                f"There is no file or folder {self.robot}; name a recorded drive, or a robot as PROFILE@ADDRESS, as in "
                "turtlebot4@tcp/192.168.0.7:7447."
            )
        return _live(self) if drive is None else _recorded(self, drive)


def _live(options: RobotVerb) -> Summary:
    # Imported here, because they need an extra that a recorded drive does not.
    from ltvn_core.robots.ros2.robot_probe import look_over
    from ltvn_core.robots.ros2.ros_robot import open_ros_robot

    robot = open_ros_robot(options.robot)
    try:
        report = look_over(robot, seconds=options.seconds, drives=options.drive)
        if options.map is None:
            return report
        return report.with_places(_place_of_robot(robot, options.map))
    finally:
        robot.close()


def _recorded(options: RobotVerb, drive: "NamedDrive") -> Summary:
    from ltvn_core.data.importing.played_drive import look_over_drive

    if options.drive:
        raise OptionError(f"--drive: {options.robot} is a recorded drive, which cannot be driven.")
    report = look_over_drive(drive, seconds=options.seconds)
    if options.map is None:
        return report
    return report.with_places(_places_of_drive(drive, options.map))


def _place_of_robot(robot: "Robot", path: Path) -> "PlacesReport":
    """Return the node of a saved map at which a robot stands. Raises RobotError, MapError and RecordingError."""
    from ltvn_core.robots.robot_view import fit_camera

    known = _opened(path)
    return _places(known, [fit_camera(robot, known.predictor.camera).observe()])


def _places_of_drive(drive: "NamedDrive", path: Path) -> "PlacesReport":
    """Return the nodes of a saved map along a recorded drive, every 12 cm or 10 degrees, faster than real time.

    Raises DriveError, MapError and RecordingError.
    """
    from ltvn_core.data.importing.played_drive import play_drive
    from ltvn_core.robots.robot import WallClock
    from ltvn_core.robots.robot_view import fit_camera, watch_drive

    known = _opened(path)
    time = _HurriedTime()
    played = play_drive(drive, WallClock(time.now, time.pass_by))
    played.observe()  # The clock of the drive starts at the second observation.
    images = watch_drive(fit_camera(played, known.predictor.camera), lambda: played.is_over)
    return _places(known, images)


class _HurriedTime:
    """A clock that advances without waiting."""

    def __init__(self) -> None:
        self._now_s = 0.0

    def now(self) -> float:
        return self._now_s

    def pass_by(self, duration_s: float) -> None:
        self._now_s += duration_s


def _opened(path: Path) -> "TopologicalMap":
    from ltvn_core.maps.topological_map import TopologicalMap

    known = TopologicalMap.load(path, with_reserve=False)
    if not known.graph.nodes:
        raise MapError(f"The map of {path} is empty, so the robot cannot be found in it.")
    return known


def _places(known: "TopologicalMap", images: "Iterable[Observation]") -> "PlacesReport":
    from ltvn_core.navigation.perception import PassiveLocaliser
    from ltvn_core.robots.robot_report import PlaceSeen, PlacesReport

    localiser = PassiveLocaliser(known.graph, known.keyframes, known.predictor, known.system)
    places = []
    for seen in images:
        found = localiser.localise(seen)
        if found is None:
            places.append(PlaceSeen(seen.stamp, None, 0.0))
        else:
            places.append(PlaceSeen(seen.stamp, found.node, found.reachability))
    return PlacesReport(tuple(places))
