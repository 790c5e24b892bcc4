"""Reads a recording: frames on demand, events in order, and the map at any step.

Does not change the file. Images stay compressed until they are requested.
"""

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ltvn_core.atomic_files import recording_path
from ltvn_core.data.recording import schema
from ltvn_core.data.recording.event_codec import decode_event
from ltvn_core.data.recording.frame_codec import EncodedFrame, decode_frame
from ltvn_core.data.recording.metadata import RecordingMetadata
from ltvn_core.data.recording.rrd_contents import RrdContents, open_contents
from ltvn_core.data.recording.rrf2.row_index import FrameTable
from ltvn_core.data.recording.stored_rows import BatchRow, StoredEvent, frame_of, stored_events
from ltvn_core.errors import CameraError, RecordingError
from ltvn_core.garbage_collection import garbage_collection_paused
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.navigation.events import GraphChanged, StampedEvent
from ltvn_core.types import FrameId, Observation, Pose

if TYPE_CHECKING:
    from ltvn_core.analysis.timeline import Timeline

_PART = 1_000
"""Number of batches of events that are decoded together."""
WITHOUT_FIRST_EVENTS = (
    "its first event is number {}, so the map that its events change is in another file, as `rerun rrd split` leaves "
    "it. Cut it from the original by `ltvn export FILE --from S --to S --output NEW.rrd`, which keeps the map."
)


class FramePoses(NamedTuple):
    """Poses of all frames of a recording, in the order of their steps."""

    steps: NDArray[np.int64]
    """Steps (N,) of the frames."""
    stamps: NDArray[np.float64]
    """Times (N,) in seconds on the robot's clock."""
    odometry: Pose
    """Odometry poses (N, 3)."""
    exact: Pose | None
    """Exact poses (N, 3) in simulation; None if any frame has none."""


class StoredFrame(NamedTuple):
    """A frame with the checksums that were stored with it."""

    frame: EncodedFrame
    rgb_checksum: int
    depth_checksum: int
    original_checksum: int = 0

    @property
    def intact(self) -> bool:
        """Whether the data is unchanged."""
        frame = self.frame
        stored = self.rgb_checksum, self.depth_checksum, self.original_checksum
        return stored == (frame.rgb_checksum, frame.depth_checksum, frame.original_checksum)


def _wrong_index(what: str) -> RecordingError:
    """Return the error for an index that differs from the rows of its file."""
    return RecordingError(
        f"The recording's index is wrong: {what}. Run `ltvn repair FILE --output NEW.rrd`, which reads without it."
    )


@dataclass(frozen=True, slots=True, eq=False)
class _StepRows:
    """The rows of an entity that has at most one valid row for each step."""

    batches: Sequence[pa.RecordBatch]
    steps: NDArray[np.int64]
    """Steps (N,), ascending."""
    numbers: NDArray[np.int64]
    """Number (N,) of each step's row among the rows of all batches."""
    starts: NDArray[np.int64]
    """Number (B + 1,) of the first row of each batch; at the end, the number of rows."""

    @classmethod
    def of(cls, contents: RrdContents, entity: str) -> Self:
        """Take the steps of all rows from the index, or else read them; of several rows with the same step, the last
        one counts."""
        batches = contents.batches_of(entity)
        index = contents.row_index
        chunks = None if index is None else index.chunks.get(f"/{entity}")
        if index is not None and chunks is not None and chunks.in_order:
            steps, rows = index.frames.steps, chunks.rows
            if entity == schema.ORIGINAL:
                steps = steps[index.frames.has_original]
        else:
            batches = [batch for batch in batches if schema.STEP in batch.schema.names]
            columns = [batch.column(schema.STEP).to_numpy(zero_copy_only=False) for batch in batches]
            steps, rows = np.concatenate([np.empty(0, np.int64), *columns]), [batch.num_rows for batch in batches]
        ascending, from_end = np.unique(steps[::-1], return_index=True)
        return cls(batches, ascending, len(steps) - 1 - from_end, np.cumsum([0, *rows]))

    def row(self, step: FrameId) -> BatchRow | None:
        """Return the row of a step; None if it has none. Raises RecordingError if the index names another's."""
        place = int(self.steps.searchsorted(step))
        if place == len(self.steps) or self.steps[place] != step:
            return None
        number = int(self.numbers[place])
        batch = int(self.starts.searchsorted(number, "right")) - 1
        row = BatchRow(self.batches[batch], number - int(self.starts[batch]))
        if row.step != step:
            raise _wrong_index(f"at the place of frame {step} is frame {row.step}")
        return row

    def numbers_of(self, steps: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the row numbers (N,) of steps (N,) that all have a row."""
        return self.numbers[np.searchsorted(self.steps, steps)]


class Recording:
    """A recording on disk, opened for reading."""

    def __init__(self, path: Path, contents: RrdContents) -> None:
        """Index the contents of a file; `Recording.open` is the entry point."""
        self.path = path
        self.meta: RecordingMetadata = contents.meta
        self._contents = contents
        self._rgb = _StepRows.of(contents, schema.RGB)
        self._depth = _StepRows.of(contents, schema.DEPTH)
        self._originals = _StepRows.of(contents, schema.ORIGINAL)
        # A truncated file may end between the two halves of a frame; only complete frames count.
        self._steps = np.intersect1d(self._rgb.steps, self._depth.steps, assume_unique=True)

    @classmethod
    def open(cls, path: Path | str, *, whole: bool = False) -> Self:
        """Open a complete and finished recording; with `whole`, read all of its rows instead of its index.

        Raises RecordingError for anything else, with advice on what to do.
        """
        path = recording_path(path)
        return cls(path, open_contents(path, whole=whole))

    @cached_property
    def frames(self) -> Sequence[FrameId]:
        """Ids of all frames, in order."""
        return tuple(self._steps.tolist())

    @property
    def half_frames(self) -> Sequence[FrameId]:
        """Return the ids of frames for which only the image or only the depth row exists; they cannot be read."""
        return tuple(np.setxor1d(self._rgb.steps, self._depth.steps, assume_unique=True).tolist())

    def observation(self, frame: FrameId) -> Observation:
        """Decode one frame. Raises RecordingError if it does not exist, ImageError if its image is unusable."""
        return decode_frame(self.stored_frame(frame).frame, str(self.path))

    def stored_frame(self, frame: FrameId) -> StoredFrame:
        """Return one frame with compressed images. Raises RecordingError if it does not exist."""
        rgb = self._rgb.row(frame)
        depth = self._depth.row(frame)
        if rgb is None or depth is None:
            held = f"{len(self.frames)} frames from {self.frames[0]} to {self.frames[-1]}" if self.frames else "none"
            raise RecordingError(f"{self.path} has no frame {frame}; it holds {held}.")
        original = self._originals.row(frame)
        encoded = frame_of(rgb, depth, original)
        if self._contents.row_index is not None:
            self._require_indexed_pose(encoded)
        return StoredFrame(
            encoded,
            rgb.checksum(schema.FRAME_ROW),
            depth.checksum(schema.DEPTH_ROW),
            0 if original is None else original.checksum(schema.ORIGINAL_ROW),
        )

    def is_intact(self, frame: FrameId) -> bool:
        """Tell whether a frame can be read and is unchanged."""
        try:
            return self.stored_frame(frame).intact
        except (LookupError, ValueError, TypeError, CameraError):
            return False

    def _require_indexed_pose(self, own: EncodedFrame) -> None:
        """Raise RecordingError if the index has another pose of a frame."""
        poses = self.poses
        row = int(poses.steps.searchsorted(own.step))
        known = (poses.stamps[row], *poses.odometry[row], *(() if poses.exact is None else poses.exact[row]))
        exact = () if poses.exact is None or own.exact_pose is None else own.exact_pose
        if known != (own.stamp, *own.odometry, *exact):
            raise _wrong_index(f"it has another pose or time of frame {own.step}")

    @cached_property
    def poses(self) -> FramePoses:
        """Poses of all frames, without reading any image."""
        if self._contents.row_index is not None:
            return _indexed_poses(self._contents.row_index.frames)
        # Reading row by row takes half a second for 20,000 frames, so whole columns are read.
        rows = self._rgb.numbers_of(self._steps)
        odometry = _column(self._rgb.batches, "odometry").reshape(-1, 3)
        exact = _column(self._rgb.batches, "exact_pose")
        return FramePoses(
            steps=self._steps,
            stamps=_column(self._rgb.batches, "stamp")[rows],
            odometry=odometry[rows],
            exact=exact.reshape(-1, 3)[rows] if exact.size == odometry.size else None,
        )

    @cached_property
    def stored_events(self) -> Sequence[StoredEvent]:
        """All events in order, still encoded as JSON."""
        events = [event for batch in self._contents.batches_of(schema.EVENTS) for event in stored_events(batch)]
        return sorted(events, key=lambda stored: stored.event.sequence)

    @cached_property
    def events(self) -> list[StampedEvent]:
        """All events in the order in which they were written.

        Raises RecordingError if an event is damaged, and for a part of a recording without its first events.
        """
        with garbage_collection_paused():
            batches = self._contents.batches_of(schema.EVENTS)
            parts = [_event_rows(batches[k : k + _PART]) for k in range(0, len(batches), _PART)]
            rows = sorted(itertools.chain.from_iterable(parts))
            if rows and rows[0][0] > 0:
                raise RecordingError(f"{self.path}: {WITHOUT_FIRST_EVENTS.format(rows[0][0])}")
            return [StampedEvent(step, stamp, decode_event(text)) for _, step, stamp, text in rows]

    @cached_property
    def timeline(self) -> "Timeline":
        """The run as queries, attempts and maps over time."""
        # Imported at its first use, because what only builds maps needs no analysis.
        timeline: type[Timeline] = import_module("ltvn_core.analysis.timeline").Timeline
        return timeline.of(self.events)

    def graph_at(self, step: FrameId) -> TopologicalGraph:
        """Return the map after all changes up to and including `step`, by applying the deltas."""
        return _folded(event for event in self.events if event.step <= step)

    def final_graph(self) -> TopologicalGraph:
        """Return the map at the end of the recording."""
        return _folded(self.events)

    def row_count(self, entity: str) -> int | None:
        """Return the number of rows of an entity with a time; None for an entity that is only drawn."""
        if entity not in schema.READ_BACK:
            return None
        return self._contents.row_count(entity)

    def user_rows(self) -> Iterator[pa.RecordBatch]:
        """Yield the rows that a user logged with `RecordingWriter.log`, as Rerun's readers return them."""
        return self._contents.user_rows()

    def questions_asked(self) -> list[str]:
        """Return the words of the questions that a person asked the debugger during the run."""
        batches = [each for each in self._contents.batches_of(schema.ASKED) if "TextLog:text" in each.schema.names]
        return [word for each in batches for words in each.column("TextLog:text").to_pylist() for word in words or ()]

    def scene_glb(self) -> bytes | None:
        """Return the scene as binary glTF; None if the file has none."""
        for batch in self._contents.batches_of(schema.SCENE):
            if (blob := BatchRow(batch, 0).blob("Asset3D:blob")) is not None:
                return blob
        return None


def _folded(events: Iterable[StampedEvent]) -> TopologicalGraph:
    return TopologicalGraph(stamped.event.delta for stamped in events if isinstance(stamped.event, GraphChanged))


def _indexed_poses(frames: FrameTable) -> FramePoses:
    order = np.argsort(frames.steps)
    exact = None if np.isnan(frames.exact).any() else frames.exact[order]
    return FramePoses(frames.steps[order], frames.stamps[order], frames.odometry[order], exact)


def _column(batches: Sequence[pa.RecordBatch], name: str) -> NDArray[np.float64]:
    """Return the numbers of a column of frames as a flat array, in the order of the file."""
    parts = [batch.column(f"{schema.FRAME_ROW}:{name}").flatten() for batch in batches]
    return np.concatenate([np.empty(0), *(part.to_numpy(zero_copy_only=False) for part in parts)])


def _event_rows(batches: Sequence[pa.RecordBatch]) -> Iterator[tuple[int, int, float, str]]:
    """Return sequence number, step, stamp and JSON text of each event."""
    columns = [
        pc.call_function(
            "list_flatten", [pa.chunked_array([each.column(f"{schema.EVENT_ROW}:{name}") for each in batches])]
        )
        for name in ("sequence", "stamp", "json")
    ]
    steps = pa.chunked_array([batch.column(schema.STEP) for batch in batches])
    sequence, stamp, text = (column.to_pylist() for column in columns)
    return zip(sequence, steps.to_pylist(), stamp, text, strict=True)
