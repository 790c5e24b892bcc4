"""What a run says of itself in the files that it writes: its recording and the maps that come of it."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.recording.map_file import save_map
from ltvn_core.recording.writer import RecordingWriter
from ltvn_core.types import Observation


@dataclass(frozen=True, slots=True, kw_only=True)
class RunDescription:
    """Where a run takes place, how it is configured, and with which weights."""

    scene: str
    """Address of the scene."""
    config: Mapping[str, Any]
    """The resolved configuration, sayable in JSON."""
    fingerprint: str
    """Names the weights in use."""
    camera: CameraModel | None = None
    """Of its images; None is the simulated robot's."""
    scene_glb: bytes | None = None
    """The scene as binary glTF, z up, to be drawn; None where nobody has a model of it."""

    def open_writer(self, path: Path, *, live_port: int | None = None) -> RecordingWriter:
        """Begin a recording of the run; raises RecordingError, and ServerError where `live_port` is taken."""
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
        """Save a map of the run as `ltvn_core.recording.map_file.save_map` does; raises MapError, RecordingError."""
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
