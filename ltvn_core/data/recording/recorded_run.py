"""Recording of a run: its metadata, and the images of its robot.

Notes are added for implausible images and for images without depth.
"""

import logging
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.data.recording.map_file import save_map
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.navigation.events import Note, Severity, StampedEvent
from ltvn_core.robots.robot import Robot
from ltvn_core.robots.robot_check import ObservationCheck
from ltvn_core.robots.robot_view import RobotView
from ltvn_core.types import Observation

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True)
class RunDescription:
    """Description of a run: its place, its configuration, and its weights."""

    scene: str
    """Address of the scene."""
    config: Mapping[str, Any]
    """Resolved configuration, as JSON values."""
    fingerprint: str
    """Fingerprint of the weights in use."""
    camera: CameraModel | None = None
    """Camera of its images; None stands for the simulated robot's camera."""
    scene_glb: bytes | None = None
    """The scene as binary glTF, z up, for drawing; None without a model."""

    def open_writer(self, path: Path, *, live_port: int | None = None) -> RecordingWriter:
        """Begin a recording of the run. Raises RecordingError, and ServerError if `live_port` is taken."""
        return RecordingWriter(
            path,
            scene=self.scene,
            config=self.config,
            fingerprint=self.fingerprint,
            camera=self.camera,
            scene_glb=self.scene_glb,
            live_port=live_port,
        )

    def save_map(
        self, path: Path, graph: TopologicalGraph, observations: Iterable[Observation], *, origin: Path | None = None
    ) -> None:
        """Save a map of the run as `data.recording.map_file.save_map` does. Raises MapError and RecordingError."""
        save_map(
            path,
            graph,
            observations,
            scene=self.scene,
            config=self.config,
            fingerprint=self.fingerprint,
            camera=self.camera,
            scene_glb=self.scene_glb,
            origin=origin,
        )


class ImageRecorder:
    """Writes the images of one robot or drive, with notes about doubtful ones."""

    def __init__(self, write_frame: Callable[[Observation], None], write_event: Callable[[StampedEvent], None]) -> None:
        """Take the functions that write images and events."""
        self._write_frame = write_frame
        self._write_event = write_event
        self._check = ObservationCheck()

    def record(self, observation: Observation) -> None:
        """Write an image, and a note about each doubt."""
        self._write_frame(observation)
        for finding in self._check.findings(observation):
            log.warning(finding)
            note = Note(str(finding), finding.severity)
            self._write_event(StampedEvent(observation.step, observation.stamp, note))


class DepthWatch:
    """Detects the first of a series of images for which the robot's depth camera returned no depth."""

    def __init__(self) -> None:
        """Start as if all earlier images had depth."""
        self._is_lost = False

    def note(self, observation: Observation) -> Note | None:
        """Return a note for the first of several images without depth; None for any other image."""
        was_lost = self._is_lost
        self._is_lost = observation.depth is not None and not observation.has_depth
        if was_lost or not self._is_lost:
            return None
        return Note(
            f"Image {observation.step} has no depth: it is kept, but not used where depth is needed.", Severity.WARN
        )


def record_images(images: Iterable[Observation], writer: RecordingWriter) -> Iterator[Observation]:
    """Write each image and yield it unchanged, for drives that yield their images.

    Notes are written at the first of several images without depth, and for implausible images.
    """
    recorder = ImageRecorder(writer.write_frame, writer.write_event)
    depth_watch = DepthWatch()
    for observation in images:
        recorder.record(observation)
        if (note := depth_watch.note(observation)) is not None:
            writer.write_event(StampedEvent(observation.step, observation.stamp, note))
        yield observation


class RecordedRobot(RobotView):
    """A robot that records its observations."""

    def __init__(self, robot: Robot, writer: RecordingWriter) -> None:
        super().__init__(robot)
        self._recorder = ImageRecorder(writer.write_frame, writer.write_event)

    def _changed(self, taken: Observation) -> Observation:
        self._recorder.record(taken)
        return taken
