"""A robot whose every look is written down. Owns nothing but that."""

from collections.abc import Iterable, Iterator

from ltvn_core.recording.writer import RecordingWriter
from ltvn_core.robots.robot import Clock, Robot
from ltvn_core.robots.robot_spec import RobotSpec
from ltvn_core.types import Observation, RobotState, Twist


def record_images(images: Iterable[Observation], writer: RecordingWriter) -> Iterator[Observation]:
    """Write each image as it comes and pass it on, for drives that yield their images."""
    for observation in images:
        writer.write_frame(observation)
        yield observation


class RecordedRobot:
    """Passes everything on to a robot and records what it sees. Implements `ltvn_core.robots.robot.Robot`."""

    def __init__(self, robot: Robot, writer: RecordingWriter) -> None:
        self._robot = robot
        self._writer = writer

    @property
    def spec(self) -> RobotSpec:
        """The robot's."""
        return self._robot.spec

    @property
    def clock(self) -> Clock:
        """The robot's."""
        return self._robot.clock

    def drive(self, twist: Twist) -> None:
        """Pass the command on."""
        self._robot.drive(twist)

    def stop(self) -> None:
        """Stop the robot."""
        self._robot.stop()

    def state(self) -> RobotState:
        """Return what the robot feels: odometry, contact, time."""
        return self._robot.state()

    def observe(self) -> Observation:
        """Take an image and record it."""
        observation = self._robot.observe()
        self._writer.write_frame(observation)
        return observation
