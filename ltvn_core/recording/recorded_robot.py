"""Records what a robot sees, with a note where an image cannot be right. Owns nothing but that."""

import logging
from collections.abc import Callable, Iterable, Iterator

from ltvn_core.navigation.events import Note, Severity, StampedEvent
from ltvn_core.recording.writer import RecordingWriter
from ltvn_core.robots.robot import Robot
from ltvn_core.robots.robot_check import ObservationCheck
from ltvn_core.robots.robot_view import RobotView
from ltvn_core.types import Observation

log = logging.getLogger(__name__)


class ImageRecorder:
    """Writes the images of one robot or drive, each with what is doubtful of it."""

    def __init__(self, write_frame: Callable[[Observation], None], write_event: Callable[[StampedEvent], None]) -> None:
        """Write images and events by these two."""
        self._write_frame = write_frame
        self._write_event = write_event
        self._check = ObservationCheck()

    def record(self, observation: Observation) -> None:
        """Write an image, and a note about each thing that cannot be right."""
        self._write_frame(observation)
        for finding in self._check.findings(observation):
            log.warning(finding)
            note = Note(str(finding), finding.severity)
            self._write_event(StampedEvent(observation.step, observation.stamp, note))


class DepthWatch:
    """Tells where images begin for which a robot's depth camera returned nothing at all."""

    def __init__(self) -> None:
        """Every image had depth so far."""
        self._is_lost = False

    def note(self, observation: Observation) -> Note | None:
        """Return what the log says of the first of some images without depth; None of any other image."""
        was_lost = self._is_lost
        self._is_lost = observation.depth is not None and not observation.has_depth
        if was_lost or not self._is_lost:
            return None
        return Note(
            f"Image {observation.step} has no depth: it is kept, and not used where depth is needed.", Severity.WARN
        )


def record_images(images: Iterable[Observation], writer: RecordingWriter) -> Iterator[Observation]:
    """Write each image as it comes and pass it on, for drives that yield their images.

    Where images without depth begin, a note says so, and where they cannot be right.
    """
    recorder = ImageRecorder(writer.write_frame, writer.write_event)
    depth_watch = DepthWatch()
    for observation in images:
        recorder.record(observation)
        if (note := depth_watch.note(observation)) is not None:
            writer.write_event(StampedEvent(observation.step, observation.stamp, note))
        yield observation


class RecordedRobot(RobotView):
    """A robot that records what it sees."""

    def __init__(self, robot: Robot, writer: RecordingWriter) -> None:
        super().__init__(robot)
        self._recorder = ImageRecorder(writer.write_frame, writer.write_event)

    def _changed(self, taken: Observation) -> Observation:
        self._recorder.record(taken)
        return taken
