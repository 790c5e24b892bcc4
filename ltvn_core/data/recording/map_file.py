"""Map files: a recording with the frames of a map's nodes and reserve, and the deltas that build the map.

Owns saving, loading and the check of the weights. `graph.builder` builds maps.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ltvn_core.atomic_files import atomic_output, recording_path
from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.data.recording.frame_codec import EncodedFrame
from ltvn_core.data.recording.metadata import RecordingMetadata
from ltvn_core.data.recording.reader import Recording
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.errors import MapError
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.types import FrameId, Observation


@dataclass(frozen=True, slots=True, eq=False)
class LoadedMap:
    """A map that was loaded from a file."""

    graph: TopologicalGraph
    observations: Mapping[FrameId, Observation]
    """Images of all nodes and of the reserve, by their frame."""
    meta: RecordingMetadata
    scene_glb: bytes | None = None
    """The scene drawn in the file, as binary glTF; None if there is none."""


def save_map(
    path: Path | str,
    graph: TopologicalGraph,
    observations: Iterable[Observation],
    *,
    scene: str,
    fingerprint: str,
    config: Mapping[str, Any],
    camera: CameraModel | None = None,
    scene_glb: bytes | None = None,
    origin: Path | None = None,
) -> None:
    """Write a map to a new file, which appears only when it is complete.

    Takes the images of all nodes and of the reserve; other images are left out. Images that are in the file
    `origin` are copied unchanged, because every compression loses quality. Without a `scene_glb`, the scene of `origin`
    is used. Raises MapError if an image is missing, RecordingError if the file exists or cannot be written.
    """
    wanted = _frames_of(graph)
    stored = None if origin is None else Recording.open(origin)
    if scene_glb is None and stored is not None:
        scene_glb = stored.scene_glb()
    kept = {observation.step: observation for observation in observations if observation.step in wanted}
    _require_images(wanted, kept.keys(), "The map cannot be saved")
    with (
        atomic_output(recording_path(path)) as part,
        RecordingWriter(
            part, scene=scene, config=config, fingerprint=fingerprint, camera=camera, scene_glb=scene_glb
        ) as writer,
    ):
        for frame in _stored_frames(stored, wanted) if stored is not None else ():
            writer.write_encoded_frame(frame)
        writer.write_map(graph, (kept[frame] for frame in sorted(kept)))


def load_map(path: Path | str) -> LoadedMap:
    """Load the final map of a map file, or of any recording in which a map was built or used.

    Raises RecordingError for a file that is not a complete recording, MapError if it holds no map.
    """
    recording = Recording.open(path)
    graph = recording.final_graph()
    if not graph.nodes:
        raise MapError(f"{path} holds {len(recording.frames)} frames but no map; run `ltvn build {path}` to make one.")
    wanted = _frames_of(graph)
    _require_images(wanted, recording.frames, str(path))
    return LoadedMap(
        graph, {frame: recording.observation(frame) for frame in sorted(wanted)}, recording.meta, recording.scene_glb()
    )


def check_fingerprint(meta: RecordingMetadata, fingerprint: str) -> None:
    """Raise MapError if a map was made by another predictor or with other weights than those in use."""
    if meta.fingerprint != fingerprint:
        named = meta.config.get("predictor")
        by = "" if named is None else f" by the predictor {named}"
        remedy = (
            "Open it with the predictor and the weights that made it, TopologicalMap.load(path, predictor)"
            if named is None
            else f"Name it with --predictor {named} and its weights; if it is already in use, its version differs"
        )
        raise MapError(
            f"This map was made{by} with the weights {meta.fingerprint!r}, but the weights in use are "
            f"{fingerprint!r}; their distances cannot be compared. {remedy}; or run `ltvn build` on the recording "
            "again."
        )


def _frames_of(graph: TopologicalGraph) -> frozenset[FrameId]:
    return frozenset(graph.frames)


def _stored_frames(recording: Recording, wanted: frozenset[FrameId]) -> Iterator[EncodedFrame]:
    return (recording.stored_frame(frame).frame for frame in recording.frames if frame in wanted)


def _require_images(wanted: frozenset[FrameId], held: Iterable[FrameId], what: str) -> None:
    missing = sorted(wanted.difference(held))
    if missing:
        raise MapError(
            f"{what}: {len(missing)} of {len(wanted)} images are missing, the first is frame {missing[0]}. Rebuild "
            "the map from the recording with `ltvn build`."
        )
