"""Writes a part of a recording to a new file. Owns the choice of what is copied."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from ltvn_core.data.recording.reader import Recording
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.navigation.events import GraphChanged, StampedEvent
from ltvn_core.types import FrameId


def rewrite(
    recording: Recording,
    output: Path,
    frames: Sequence[FrameId],
    events: Iterable[StampedEvent],
    *,
    scene_glb: bytes | None = None,
) -> None:
    """Write frames, events and the user's own rows of a recording to a new file, and draw them again.

    `scene_glb` is drawn if the recording has no scene. Raises RecordingError.
    """
    graph = TopologicalGraph()
    left = list(reversed(frames))
    with open_rewriter(recording, output, recording_id=recording.meta.recording_id, scene_glb=scene_glb) as writer:
        for stamped in events:
            while left and left[-1] <= stamped.step:
                writer.write_encoded_frame(recording.stored_frame(left.pop()).frame)
            rewrite_event(writer, stamped, graph)
        while left:
            writer.write_encoded_frame(recording.stored_frame(left.pop()).frame)
        for batch in recording.user_rows():
            writer.copy_user_rows(batch)


def open_rewriter(
    recording: Recording,
    output: Path,
    *,
    recording_id: str,
    config: Mapping[str, Any] | None = None,
    scene_glb: bytes | None = None,
) -> RecordingWriter:
    """Open a new file with the metadata of a recording, or with another `config`.

    `scene_glb` is drawn if the recording has no scene. Rerun shows two files with the same `recording_id` as one.
    Raises RecordingError.
    """
    meta = recording.meta
    return RecordingWriter(
        output,
        scene=meta.scene,
        config=meta.config if config is None else config,
        fingerprint=meta.fingerprint,
        camera=meta.camera,
        scene_glb=recording.scene_glb() or scene_glb,
        recording_id=recording_id,
        started_at=meta.started_at,
    )


def rewrite_event(writer: RecordingWriter, stamped: StampedEvent, graph: TopologicalGraph) -> None:
    """Write an event; if it changes the map, also apply the change to `graph` and draw the map."""
    writer.write_event(stamped)
    if isinstance(stamped.event, GraphChanged):
        graph.apply(stamped.event.delta)
        writer.draw_graph(graph, stamped.step, stamped.stamp)
