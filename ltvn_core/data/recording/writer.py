"""Writes a recording: frames, events and snapshots of the map, as exact columns beside the viewer's drawing.

Owns the entity of each row, and the interval at which the map is drawn. `durable_stream` writes the file safely;
`map_drawing` and `event_drawing` define the shapes.
"""

from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any, Self
from uuid import uuid4

import pyarrow as pa
import rerun as rr

from ltvn_core.atomic_files import MIN_FREE_DISK_BYTES
from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.data.recording import event_drawing, map_drawing, schema
from ltvn_core.data.recording.blueprint import Layout
from ltvn_core.data.recording.drawn_poses import DrawnPoses, FloorExtent
from ltvn_core.data.recording.durable_stream import PATIENCE_S, DurableStream
from ltvn_core.data.recording.event_codec import EncodedEvent
from ltvn_core.data.recording.event_drawing import BeliefDrawing
from ltvn_core.data.recording.frame_codec import EncodedFrame, camera_text, encode_frame
from ltvn_core.data.recording.map_drawing import DrawnEntity, NodeImages
from ltvn_core.data.recording.metadata import RecordingMetadata, metadata_row, package_versions
from ltvn_core.data.recording.schema import ArchetypeColumns, RowTime, integer_column, number_column, text_column
from ltvn_core.errors import RecordingError
from ltvn_core.graph.deltas import NodeAdded
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.navigation.events import GraphChanged, Note, StampedEvent
from ltvn_core.readable_text import readable
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.types import FrameId, Observation, OriginalImage

_SNAPSHOT_S = 0.5
_SNAPSHOT_S_PER_EDGE = 0.002
"""Least time in seconds per edge between two drawings of the map, so that a large map takes only a small part of the
file."""


class RecordingWriter:
    """Writes one new recording; a context manager.

    Raises RecordingError if the file exists or cannot be created, and once from any method if the disk stops accepting
    data; later rows are discarded, and `failure` gives the reason. Writing waits only for a disk that is far behind.
    """

    def __init__(
        self,
        path: Path | str,
        *,
        scene: str = "",
        config: Mapping[str, Any] | None = None,
        fingerprint: str = "",
        camera: CameraModel | None = None,
        scene_glb: bytes | None = None,
        recording_id: str = "",
        started_at: str = "",
        min_free_bytes: int = MIN_FREE_DISK_BYTES,
        live_port: int | None = None,
        patience_s: float = PATIENCE_S,
    ) -> None:
        """Begin a recording at `path`.

        `scene` names the place, and `fingerprint` the predictor whose map the run uses; both may stay empty. `config`
        must consist of JSON values. Without a `camera`, the images count as those of the simulated robot. `scene_glb`
        is drawn, see `draw_scene`. `recording_id` and `started_at` are for rewriting an older recording. Recording
        stops if the disk has less than `min_free_bytes` left. Rerun viewers on this machine can watch at `live_port`;
        raises ServerError if it is taken. If the disk is far behind, writing waits for it up to `patience_s`; 0 is for
        a robot in real time.
        """
        scene = readable(scene)  # It may be the name of a folder.
        camera = camera or LOCOBOT.camera
        recording_id = recording_id or str(uuid4())
        started_at = started_at or datetime.now(UTC).isoformat(timespec="seconds")
        versions = package_versions()
        meta = RecordingMetadata(
            scene=scene,
            config=config or {},
            fingerprint=fingerprint,
            camera=camera,
            schema=schema.SCHEMA_VERSION,
            versions=versions,
            started_at=started_at,
            recording_id=recording_id,
        )
        description = metadata_row(meta)
        self._stream = DurableStream(
            Path(path),
            recording_id=recording_id,
            min_free_bytes=min_free_bytes,
            live_port=live_port,
            patience_s=patience_s,
        )
        self._frames: set[FrameId] = set()
        self._events = 0
        self._drawn_poses = DrawnPoses()
        self._map = map_drawing.MapDrawing()
        self._beliefs = BeliefDrawing()
        self._node_images = NodeImages()
        self._draw_schedule = _DrawSchedule()
        self._newest = RowTime(0, 0.0)
        self._user_scalars: dict[str, None] = {}
        self._scene_extent = None if scene_glb is None else FloorExtent.of_glb(scene_glb)
        self._stream.begin(f"{scene} {started_at}", description, Layout(floor=self._scene_extent))
        for part in map_drawing.static_entities(camera):
            self._stream.log_static(part.entity, *part.values)
        if scene_glb is not None:
            self.draw_scene(scene_glb)
        self._stream.flush()

    @property
    def path(self) -> Path:
        """Path of the file."""
        return self._stream.path

    @property
    def failure(self) -> str | None:
        """Reason why the recording stopped after a failure, or None."""
        return self._stream.failure

    def draw_scene(self, glb: bytes) -> None:
        """Draw the scene; this adds its size to the file. Any thread may call this while others write."""
        self._scene_extent = FloorExtent.of_glb(glb)
        part = map_drawing.draw_scene(glb)
        self._stream.log_static(part.entity, *part.values)

    def write_frame(self, observation: Observation) -> None:
        """Write a frame, unless it was written already. The caller may reuse its arrays at once."""
        if observation.step not in self._frames:
            self.write_encoded_frame(encode_frame(observation))

    def write_encoded_frame(self, frame: EncodedFrame) -> None:
        """Write a frame whose images are already compressed."""
        if frame.step in self._frames:
            return
        self._frames.add(frame.step)
        self._drawn_poses.add_frame(frame.step, frame.drawn_pose)
        self._node_images.add_frame(frame.step, frame.rgb)
        time = self._newest = RowTime(frame.step, frame.stamp)
        with self._stream.together():
            self._stream.log(time, schema.RGB, *_rgb_row(frame))
            self._stream.log(time, schema.DEPTH, *_depth_row(frame))
            if frame.original is not None:
                self._stream.log(time, schema.ORIGINAL, *_original_row(frame, frame.original))
            self._stream.index(frame)
            self._draw(time, map_drawing.draw_robot(frame.drawn_pose, frame.odometry))

    def write_event(self, stamped: StampedEvent) -> None:
        """Write an event in exact form, and as the viewer draws it."""
        time = self._newest = RowTime(int(stamped.step), float(stamped.stamp), self._events)
        if isinstance(stamped.event, GraphChanged) and isinstance(stamped.event.delta, NodeAdded):
            self._drawn_poses.add_node(stamped.event.delta.node)
        encoded = EncodedEvent.of(stamped, sequence=self._events)
        self._events += 1
        with self._stream.together():
            self._stream.log(time, schema.EVENTS, _event_row(encoded))
            self._draw(time, event_drawing.draw_event(stamped.event, self._drawn_poses))
            self._draw(time, self._node_images.draw(stamped.event))
            self._draw(time, self._beliefs.draw(stamped.event, time))

    def log(
        self, entity: str, *values: rr.AsComponents | float, step: FrameId | None = None, stamp: float | None = None
    ) -> None:
        """Write a row of your own, for instance `writer.log("score", 0.7)`, for the Rerun viewer and its dataframes.

        Args:
            entity: Path of the entity; one below `world` is drawn in the 3D view.
            values: Archetypes of Rerun, or one number, which is plotted.
            step: Control step of the row; that of the newest frame or event where it is left out.
            stamp: Seconds on the robot's clock; those of the newest frame or event where it is left out.

        Raises:
            RecordingError: The recorder itself writes this entity, or no values are given.
        """
        path = entity.strip("/")
        if not path or schema.is_own_entity(path):
            raise RecordingError(
                f"The entity {entity!r} is reserved for the recorder. Choose another path, such as "
                f"my/{path or 'values'}."
            )
        if not values:
            raise RecordingError(f"There is nothing to write to {entity!r}. Give an archetype of Rerun or a number.")
        if any(isinstance(value, int | float) for value in values):
            self._user_scalars[f"/{path}"] = None
        time = RowTime(
            self._newest.step if step is None else int(step), self._newest.stamp if stamp is None else float(stamp)
        )
        rows = [rr.Scalars(value) if isinstance(value, int | float) else value for value in values]
        with self._stream.together():
            self._stream.log(time, path, *rows)

    def write_question(self, word: str) -> None:
        """Write the word of a question that a person asked the debugger."""
        self.log(schema.ASKED, rr.TextLog(word))

    def copy_user_rows(self, batch: pa.RecordBatch) -> None:
        """Write the user's own rows of another recording, see `Recording.user_rows`."""
        with self._stream.together():
            self._stream.send(batch)

    def draw_graph(self, graph: TopologicalGraph, step: FrameId, stamp: float) -> None:
        """Draw the map if it has changed, at most twice a second; may be called at any time."""
        time = RowTime(int(step), float(stamp))
        if self._draw_schedule.is_due(graph, time):
            self._draw_graph(graph, time)

    def write_map(self, graph: TopologicalGraph, observations: Iterable[Observation]) -> None:
        """Write a whole map with its frames, so that later rows need no other file; must be called first."""
        last = RowTime(0, 0.0)
        for observation in observations:
            self.write_frame(observation)
            self._node_images.keep([observation.step])
            last = max(last, RowTime(int(observation.step), float(observation.stamp)))
        for delta in graph.deltas():
            self.write_event(StampedEvent(last.step, last.stamp, GraphChanged(delta)))
        text = f"map with {len(graph.nodes)} nodes, {len(graph.edges)} edges and {len(graph.reserve)} images in reserve"
        self.write_event(StampedEvent(last.step, last.stamp, Note(text)))
        self.draw_graph(graph, last.step, last.stamp)

    def close(self) -> None:
        """Draw the final map and finish the file. Raises RecordingError if that fails; may be called again."""
        try:
            if (pending := self._draw_schedule.pending()) is not None and not self._stream.closed:
                self._draw_graph(*pending)
            self._stream.arrange(self._final_layout())
        finally:
            self._stream.close()

    def __enter__(self) -> Self:
        """Return this writer."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Finish the file, also after an exception."""
        self.close()

    def _final_layout(self) -> Layout:
        return Layout(
            floor=self._scene_extent or self._drawn_poses.extent,
            edges=self._beliefs.shown_edges,
            user_scalars=list(self._user_scalars),
        )

    def _draw_graph(self, graph: TopologicalGraph, time: RowTime) -> None:
        self._draw_schedule.drawn(graph, time)
        for node in graph.nodes.values():
            self._drawn_poses.add_node(node)
        nodes = tuple(graph.nodes.values())
        edges = tuple(graph.edges.values())
        blocked = [key for key, observed in graph.presence.items() if not observed[-1].present]
        self._draw(time, self._map.draw(nodes, edges, blocked, self._drawn_poses))

    def _draw(self, time: RowTime, parts: Iterable[DrawnEntity]) -> None:
        for part in parts:
            self._stream.log(part.time or time, part.entity, *part.values)


class _DrawSchedule:
    """Decides when the map is drawn: after a change, and less often for a larger map."""

    def __init__(self) -> None:
        self._drawn: tuple[int, int] | None = None
        self._next_stamp = float("-inf")
        self._waiting: tuple[TopologicalGraph, RowTime] | None = None

    def is_due(self, graph: TopologicalGraph, time: RowTime) -> bool:
        if self._drawn == (id(graph), graph.version):
            return False
        self._waiting = graph, time
        return time.stamp >= self._next_stamp

    def drawn(self, graph: TopologicalGraph, time: RowTime) -> None:
        self._drawn = (id(graph), graph.version)
        self._waiting = None
        self._next_stamp = time.stamp + max(_SNAPSHOT_S, _SNAPSHOT_S_PER_EDGE * len(graph.edges))

    def pending(self) -> tuple[TopologicalGraph, RowTime] | None:
        return self._waiting


def _rgb_row(frame: EncodedFrame) -> tuple[rr.AsComponents, ...]:
    columns = {
        "stamp": number_column(frame.stamp),
        "odometry": number_column(frame.odometry),
        "exact_pose": number_column(() if frame.exact_pose is None else frame.exact_pose),
        "crc32": integer_column(frame.rgb_checksum),
    }
    if frame.tilt is not None:
        columns["tilt"] = number_column(frame.tilt)
    return rr.EncodedImage.from_fields(blob=frame.rgb), ArchetypeColumns(schema.FRAME_ROW, columns)


def _depth_row(frame: EncodedFrame) -> tuple[rr.AsComponents, ...]:
    columns = {"crc32": integer_column(frame.depth_checksum)}
    row = ArchetypeColumns(schema.DEPTH_ROW, columns)
    return (row,) if frame.depth is None else (rr.EncodedDepthImage.from_fields(blob=frame.depth), row)


def _original_row(frame: EncodedFrame, original: OriginalImage) -> tuple[rr.AsComponents, ...]:
    columns = {
        "camera": text_column(camera_text(original.camera)),
        "crc32": integer_column(frame.original_checksum),
    }
    picture = rr.EncodedImage(contents=original.jpeg, media_type="image/jpeg")
    return picture, ArchetypeColumns(schema.ORIGINAL_ROW, columns)


def _event_row(event: EncodedEvent) -> ArchetypeColumns:
    return ArchetypeColumns(
        schema.EVENT_ROW,
        {
            "sequence": integer_column(event.sequence),
            "stamp": number_column(event.stamp),
            "kind": text_column(event.kind),
            "json": text_column(event.json),
            "crc32": integer_column(event.checksum),
        },
    )
