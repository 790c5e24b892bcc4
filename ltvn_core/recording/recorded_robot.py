"""A robot whose every look is written down, with a note where a look cannot be right. Owns nothing but that."""

import logging
from collections.abc import Iterable, Iterator

from ltvn_core.navigation.events import Note, Severity, StampedEvent
from ltvn_core.recording.writer import RecordingWriter
from ltvn_core.robots.robot import Clock, Robot
from ltvn_core.robots.robot_check import ObservationCheck
from ltvn_core.robots.robot_spec import RobotSpec
from ltvn_core.types import Observation, RobotState, Twist

log = logging.getLogger(__name__)


def record_images(images: Iterable[Observation], writer: RecordingWriter) -> Iterator[Observation]:
    """Write each image as it comes and pass it on, for drives that yield their images.

    Where images without depth begin, a note says so, and where they cannot be right.
    """
    without_depth = False
    check = ObservationCheck()
    for observation in images:
        writer.write_frame(observation)
        _write_findings(check, observation, writer)
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
        self._check = ObservationCheck()

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
        _write_findings(self._check, observation, self._writer)
        return observation


def _write_findings(check: ObservationCheck, observation: Observation, writer: RecordingWriter) -> None:
    for finding in check.findings(observation):
        log.warning(finding)
        note = Note(str(finding), finding.severity)
        writer.write_event(StampedEvent(observation.step, observation.stamp, note))
