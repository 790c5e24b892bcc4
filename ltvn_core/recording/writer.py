"""Writes a recording: frames, events and snapshots of the map, exact columns beside what the viewer draws.

Owns which row goes where and how often the map is drawn. The file and its safety are `stream`; shapes are `drawing` and
`event_drawing`.
"""

from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self
from uuid import uuid4

import rerun as rr

from ltvn_core.graph.deltas import NodeAdded
from ltvn_core.graph.topograph import TopologicalGraph
from ltvn_core.nav.events import GraphChanged, Note, Stamped
from ltvn_core.recording import drawing, event_drawing, schema
from ltvn_core.recording.blueprint import blueprint
from ltvn_core.recording.codec import EncodedEvent
from ltvn_core.recording.drawing import Drawn
from ltvn_core.recording.frames import EncodedFrame, encode_frame
from ltvn_core.recording.meta import Meta, meta_row, package_versions
from ltvn_core.recording.places import Places
from ltvn_core.recording.rows import Row, integers, numbers, texts
from ltvn_core.recording.stream import RESERVE_BYTES, DurableStream
from ltvn_core.types import FrameId, Intrinsics, Observation

_SNAPSHOT_S = 0.5
_SNAPSHOT_S_PER_EDGE = 0.002
"""A large map is drawn less often, so that drawing stays a small part of the file."""


class _Moment(NamedTuple):
    step: FrameId
    stamp: float


class RecordingWriter:
    """Writes one new recording; a context manager.

    Raises RecordingError when the file exists or cannot be made, and once from any method when the disk stops taking
    data; rows after that are dropped and `failure` says why. Nothing here waits for the disk except `close`.
    """

    def __init__(
        self,
        path: Path | str,
        *,
        scene: str,
        config: Mapping[str, Any],
        fingerprint: str,
        intrinsics: Intrinsics | None = None,
        scene_glb: bytes | None = None,
        recording_id: str = "",
        started_at: str = "",
        reserve_bytes: int = RESERVE_BYTES,
        live_port: int | None = None,
    ) -> None:
        """Begin a recording at `path`.

        `config` must be sayable in JSON. `scene_glb` is drawn and makes the file larger by its size. `recording_id` and
        `started_at` are for rewriting an older recording. Recording stops when the disk has less than `reserve_bytes`.
        Rerun viewers of this machine can watch at `live_port`; raises ServerError when it is taken.
        """
        intrinsics, recording_id = intrinsics or Intrinsics(), recording_id or str(uuid4())
        started_at = started_at or datetime.now(UTC).isoformat(timespec="seconds")
        versions = package_versions()
        meta = Meta(scene, config, fingerprint, intrinsics, schema.SCHEMA, versions, started_at, recording_id)
        description = meta_row(meta)
        self._stream = DurableStream(
            Path(path), recording_id=recording_id, reserve_bytes=reserve_bytes, live_port=live_port
        )
        self._frames: set[FrameId] = set()
        self._events = 0
        self._places = Places()
        self._curves = event_drawing.BeliefCurves()
        self._snapshots = _Snapshots()
        self._stream.begin(f"{scene} {started_at}", description, blueprint())
        for part in drawing.fixed_parts(intrinsics, scene_glb):
            self._stream.log_static(part.entity, *part.values)
        self._stream.flush()

    @property
    def path(self) -> Path:
        """The file that is written."""
        return self._stream.path

    @property
    def failure(self) -> str | None:
        """Why the recording stopped by itself, or None."""
        return self._stream.failure

    def frame(self, observation: Observation) -> None:
        """Write a frame; one that is there already is left alone. The caller may reuse its arrays at once."""
        if observation.step not in self._frames:
            self.encoded_frame(encode_frame(observation))

    def encoded_frame(self, frame: EncodedFrame) -> None:
        """Write a frame whose pictures are compressed already."""
        if frame.step in self._frames:
            return
        self._frames.add(frame.step)
        self._places.add_frame(frame.step, frame.drawn_pose)
        moment = _Moment(frame.step, frame.stamp)
        self._stream.log(*moment, schema.RGB, *_rgb_row(frame))
        self._stream.log(*moment, schema.DEPTH, *_depth_row(frame))
        self._draw(moment, drawing.robot(frame.drawn_pose, frame.odometry))

    def event(self, stamped: Stamped) -> None:
        """Write an event, exactly and as the viewer shows it."""
        moment = _Moment(int(stamped.step), float(stamped.stamp))
        if isinstance(stamped.event, GraphChanged) and isinstance(stamped.event.delta, NodeAdded):
            self._places.add_node(stamped.event.delta.node)
        encoded = EncodedEvent.of(stamped, sequence=self._events)
        self._events += 1
        self._stream.log(*moment, schema.EVENTS, _event_row(encoded))
        for part in self._curves.begun(stamped.event):
            self._stream.log_static(part.entity, *part.values)
        self._draw(moment, event_drawing.drawn(stamped.event, self._places))
        self._draw(moment, self._curves.continued(stamped.event))

    def graph(self, graph: TopologicalGraph, step: FrameId, stamp: float) -> None:
        """Draw the map if it changed, at most twice a second; call it as often as you like."""
        moment = _Moment(int(step), float(stamp))
        if self._snapshots.due(graph, moment):
            self._draw_graph(graph, moment)

    def map(self, graph: TopologicalGraph, observations: Iterable[Observation]) -> None:
        """Write a whole map with its frames, so that what follows needs no other file; call it first."""
        last = _Moment(0, 0.0)
        for observation in observations:
            self.frame(observation)
            last = max(last, _Moment(int(observation.step), float(observation.stamp)))
        for delta in graph.deltas():
            self.event(Stamped(*last, GraphChanged(delta)))
        text = f"map with {len(graph.nodes)} nodes, {len(graph.edges)} edges and {len(graph.reserve)} images in reserve"
        self.event(Stamped(*last, Note(text)))
        self.graph(graph, *last)

    def close(self) -> None:
        """Draw the map as it is now and finish the file. Raises RecordingError when that fails; may be repeated."""
        try:
            if (late := self._snapshots.late()) is not None and not self._stream.closed:
                self._draw_graph(*late)
        finally:
            self._stream.close()

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Finish the file, whatever happened."""
        self.close()

    def _draw_graph(self, graph: TopologicalGraph, moment: _Moment) -> None:
        self._snapshots.drawn(graph, moment)
        for node in graph.nodes.values():
            self._places.add_node(node)
        self._draw(moment, drawing.graph(tuple(graph.nodes.values()), tuple(graph.edges.values()), self._places))

    def _draw(self, moment: _Moment, parts: Iterable[Drawn]) -> None:
        for part in parts:
            self._stream.log(*moment, part.entity, *part.values)


class _Snapshots:
    """Decides when the map is drawn: on change, and not too often for its size."""

    def __init__(self) -> None:
        self._drawn: tuple[int, int] | None = None
        self._next_stamp = float("-inf")
        self._waiting: tuple[TopologicalGraph, _Moment] | None = None

    def due(self, graph: TopologicalGraph, moment: _Moment) -> bool:
        if self._drawn == (id(graph), graph.version):
            return False
        self._waiting = graph, moment
        return moment.stamp >= self._next_stamp

    def drawn(self, graph: TopologicalGraph, moment: _Moment) -> None:
        self._drawn, self._waiting = (id(graph), graph.version), None
        self._next_stamp = moment.stamp + max(_SNAPSHOT_S, _SNAPSHOT_S_PER_EDGE * len(graph.edges))

    def late(self) -> tuple[TopologicalGraph, _Moment] | None:
        return self._waiting


def _rgb_row(frame: EncodedFrame) -> tuple[rr.AsComponents, ...]:
    columns = {
        "stamp": numbers(frame.stamp),
        "odometry": numbers(frame.odometry),
        "exact_pose": numbers(() if frame.exact_pose is None else frame.exact_pose),
        "crc32": integers(frame.rgb_checksum),
    }
    return rr.EncodedImage.from_fields(blob=frame.rgb), Row(schema.FRAME_ROW, columns)


def _depth_row(frame: EncodedFrame) -> tuple[rr.AsComponents, ...]:
    columns = {"crc32": integers(frame.depth_checksum)}
    return rr.EncodedDepthImage.from_fields(blob=frame.depth), Row(schema.DEPTH_ROW, columns)


def _event_row(event: EncodedEvent) -> Row:
    return Row(
        schema.EVENT_ROW,
        {
            "sequence": integers(event.sequence),
            "stamp": numbers(event.stamp),
            "kind": texts(event.kind),
            "json": texts(event.json),
            "crc32": integers(event.checksum),
        },
    )
