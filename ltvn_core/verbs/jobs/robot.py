"""`ltvn robot check`: looks a robot of ROS 2 over before anybody drives it, or a recorded drive that plays one."""

from ltvn_core.errors import OptionError
from ltvn_core.importing.drive_check import look_over_drive
from ltvn_core.importing.named_drive import NamedDrive
from ltvn_core.robots.robot_report import with_places
from ltvn_core.verbs.jobs.robot_places import place_of_robot, places_of_drive
from ltvn_core.verbs.robot import RobotVerb
from ltvn_core.verbs.verb import Summary


def check_robot(options: RobotVerb) -> Summary:
    """Watch, and drive where told to; raises OptionError, DriveError, RobotError and MapError."""
    if not 0.5 <= options.seconds <= 600:
        raise OptionError(f"--seconds is from 0.5 to 600, got {options.seconds}.")
    drive = NamedDrive.find(options.robot)
    if drive is None and "@" not in options.robot:
        raise OptionError(
            f"There is no file or folder {options.robot}; name a recorded drive, or a robot as PROFILE@ADDRESS, as in "
            "turtlebot4@tcp/192.168.0.7:7447."
        )
    return _live(options) if drive is None else _recorded(options, drive)


def _live(options: RobotVerb) -> Summary:
    # They need an extra that a recorded drive does not.
    from ltvn_core.robots.ros2.robot_probe import look_over
    from ltvn_core.robots.ros2.ros_robot import open_ros_robot

    robot = open_ros_robot(options.robot)
    try:
        report = look_over(robot, seconds=options.seconds, drives=options.drive)
        if options.map is None:
            return report
        return with_places(report, place_of_robot(robot, options.map))
    finally:
        robot.close()


def _recorded(options: RobotVerb, drive: NamedDrive) -> Summary:
    if options.drive:
        raise OptionError(f"--drive: {options.robot} is a recorded drive, which can be watched alone.")
    report = look_over_drive(drive, seconds=options.seconds)
    if options.map is None:
        return report
    return with_places(report, places_of_drive(drive, options.map))
