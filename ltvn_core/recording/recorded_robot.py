"""A robot whose every look is written down. Owns nothing but that."""

from collections.abc import Iterable, Iterator

from ltvn_core.navigation.events import Note, Severity, StampedEvent
from ltvn_core.recording.writer import RecordingWriter
from ltvn_core.robots.robot import Clock, Robot
from ltvn_core.robots.robot_spec import RobotSpec
from ltvn_core.types import Observation, RobotState, Twist


def record_images(images: Iterable[Observation], writer: RecordingWriter) -> Iterator[Observation]:
    """Write each image as it comes and pass it on, for drives that yield their images.

    Where images without depth begin, a note says so.
    """
    without_depth = False
    for observation in images:
        writer.write_frame(observation)
        if lost_depth(observation) and not without_depth:
            writer.write_event(StampedEvent(observation.step, observation.stamp, missing_depth_note(observation)))
        without_depth = lost_depth(observation)
        yield observation


def lost_depth(observation: Observation) -> bool:
    """Tell whether the robot has a depth camera and it returned nothing at all."""
    return observation.depth is not None and not observation.has_depth


def missing_depth_note(observation: Observation) -> Note:
    """Return what the log says of the first of some images without depth."""
    return Note(
        f"Image {observation.step} has no depth: it is kept, and not used where depth is needed.", Severity.WARN
    )


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
