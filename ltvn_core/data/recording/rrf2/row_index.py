"""Index of a finished recording: the messages with the rows that are read back, and the poses of all frames.

With it, a recording of many hours opens without a look at its images. It is in the end message, as a field that Rerun
skips, and the closing record's checksums cover it. Owns its layout. A recording without an index is read as a whole.
"""

from array import array
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ltvn_core.data.recording import schema
from ltvn_core.data.recording.rrf2.arrow_tables import read_table
from ltvn_core.data.recording.rrf2.chunk_table import ListedChunk
from ltvn_core.data.recording.rrf2.layout import CHUNK_KIND, MessageSums
from ltvn_core.protobuf_fields import bytes_field, bytes_fields, number_field, read_fields
from ltvn_core.types import FrameId, Pose

_FIELD = 7001
"""Number of the protobuf field; Rerun has no such field and skips it."""
_RECORDING_ID, _BODY_CRC32, _CHUNKS, _FRAMES = 1, 2, 3, 4
_COMPRESSED = pa.ipc.IpcWriteOptions(compression="zstd")
_AXES = ("x", "y", "yaw")


class FrameTable(NamedTuple):
    """All frames of a recording, in the order in which they were written."""

    steps: NDArray[np.int64]
    """(N,)."""
    stamps: NDArray[np.float64]
    """Times (N,) in seconds on the robot's clock."""
    odometry: Pose
    """(N, 3)."""
    exact: Pose
    """Exact poses (N, 3) in simulation; NaN for a frame without one."""
    has_original: NDArray[np.bool_]
    """Whether the camera's original image was kept, (N,)."""


class IndexedChunks(NamedTuple):
    """The chunks of one entity, in the order of the file."""

    messages: NDArray[np.int64]
    """Number (N,) of each chunk's message in the file."""
    rows: NDArray[np.int64]
    """Number of rows (N,)."""
    in_order: bool
    """Whether the rows of images are in the order of the frames.

    Rerun sorts rows with different columns into different chunks, such as images with and without a tilt.
    """


@dataclass(frozen=True, slots=True, eq=False)
class RowIndex:
    """The index of a recording."""

    recording_id: str
    body_crc32: int
    """CRC-32 of all bytes before the end message."""
    chunks: Mapping[str, IndexedChunks]
    """By entity path, with a leading slash."""
    frames: FrameTable


@dataclass(slots=True, eq=False)
class FrameList:
    """Collects the frames of a recording while it is written, some 70 bytes each."""

    steps: "array[int]" = field(default_factory=lambda: array("q"))
    numbers: "array[float]" = field(default_factory=lambda: array("d"))
    """Stamp, odometry and exact pose of each frame: seven numbers."""
    originals: bytearray = field(default_factory=bytearray)

    def append(self, step: FrameId, stamp: float, odometry: Pose, exact: Pose | None, *, has_original: bool) -> None:
        """Append a frame."""
        self.steps.append(step)
        self.numbers.extend((stamp, *odometry, *((np.nan,) * 3 if exact is None else exact)))
        self.originals.append(has_original)

    def table(self) -> FrameTable:
        """Return a copy of all frames so far."""
        numbers = np.array(self.numbers, np.float64).reshape(-1, 7)
        return FrameTable(
            np.array(self.steps, np.int64),
            numbers[:, 0],
            numbers[:, 1:4],
            numbers[:, 4:],
            np.frombuffer(bytes(self.originals), bool),
        )


def index_field(
    recording_id: str,
    body_crc32: int,
    listed: Mapping[str, Sequence[ListedChunk]],
    messages: MessageSums,
    frames: FrameTable,
) -> bytes:
    """Encode the index as a field of the end message; empty if the chunks do not hold as many images as there are
    frames."""
    listed = {
        entity: [chunk for chunk in chunks if not (chunk.is_static and entity.strip("/") in schema.COLUMNS)]
        for entity, chunks in listed.items()
    }
    steps_of = {
        f"/{schema.RGB}": frames.steps,
        f"/{schema.DEPTH}": frames.steps,
        f"/{schema.ORIGINAL}": frames.steps[frames.has_original],
    }
    if any(sum(chunk.rows for chunk in listed.get(entity, ())) != len(steps) for entity, steps in steps_of.items()):
        return b""
    of_chunk = np.flatnonzero(messages["kind"] == CHUNK_KIND).tolist()
    names = sorted((entity for entity, chunks in listed.items() if chunks), key=lambda entity: listed[entity][0])
    rows = [(number, chunk) for number, name in enumerate(names) for chunk in listed[name]]
    in_order = [name not in steps_of or _are_in_order(listed[name], steps_of[name]) for name in names]
    chunks = pa.record_batch(
        {
            "entity": pa.DictionaryArray.from_arrays(pa.array([number for number, _ in rows], pa.int32()), names),
            "message": pa.array([of_chunk[chunk.number] for _, chunk in rows], pa.int64()),
            "rows": pa.array([chunk.rows for _, chunk in rows], pa.int64()),
            "in_order": pa.array([in_order[number] for number, _ in rows], pa.bool_()),
        }
    )
    columns = {
        "step": pa.array(frames.steps),
        "stamp": pa.array(frames.stamps),
        **{f"odometry_{axis}": pa.array(frames.odometry[:, k]) for k, axis in enumerate(_AXES)},
        **{f"exact_{axis}": pa.array(frames.exact[:, k]) for k, axis in enumerate(_AXES)},
        "has_original": pa.array(frames.has_original),
    }
    body = b"".join(
        (
            bytes_field(_RECORDING_ID, recording_id.encode()),
            number_field(_BODY_CRC32, body_crc32),
            bytes_field(_CHUNKS, _encoded(chunks)),
            bytes_field(_FRAMES, _encoded(pa.record_batch(columns))),
        )
    )
    return bytes_field(_FIELD, body)


def read_index(appended: bytes, file_bytes: int) -> RowIndex | None:
    """Return the index among the fields of an undamaged end message, for the `file_bytes` before it.

    None if it has none, or one that cannot be right or has another layout: the file is then read as a whole.
    """
    try:
        for number, body in read_fields(appended):
            if number == _FIELD and isinstance(body, bytes):
                return _parsed(body, file_bytes)
    except (pa.ArrowException, LookupError, TypeError, ValueError, AttributeError):
        pass
    return None


def _are_in_order(chunks: Iterable[ListedChunk], steps: NDArray[np.int64]) -> bool:
    """Tell whether chunks hold rows at these steps (N,), in this order."""
    start = 0
    for chunk in chunks:
        inside = steps[start : start + chunk.rows]
        if (inside.min(), inside.max()) != (chunk.first_step, chunk.last_step):
            return False
        start += chunk.rows
    return True


def _encoded(batch: pa.RecordBatch) -> bytes:
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, batch.schema, options=_COMPRESSED) as writer:
        writer.write_batch(batch)
    return sink.getvalue().to_pybytes()


_CHUNK_TYPES = {
    "entity": pa.dictionary(pa.int32(), pa.utf8()),
    "message": pa.int64(),
    "rows": pa.int64(),
    "in_order": pa.bool_(),
}
_FRAME_TYPES = {
    "step": pa.int64(),
    "stamp": pa.float64(),
    **{f"{pose}_{axis}": pa.float64() for pose in ("odometry", "exact") for axis in _AXES},
    "has_original": pa.bool_(),
}


def _parsed(body: bytes, file_bytes: int) -> RowIndex:
    parts = {each.number: each.value for each in read_fields(body)}
    # No index is larger than what it tells of.
    chunks, frames = (read_table(bytes_fields(body)[number], file_bytes) for number in (_CHUNKS, _FRAMES))
    for table, types in ((chunks, _CHUNK_TYPES), (frames, _FRAME_TYPES)):
        if {field.name: field.type for field in table.schema} != types or any(each.null_count for each in table):
            raise ValueError("an index with other columns")
    numbers = chunks.column("entity").indices.to_numpy()
    messages = chunks.column("message").to_numpy()
    rows = chunks.column("rows").to_numpy()
    in_order = chunks.column("in_order").to_numpy(zero_copy_only=False)
    columns = {name: frames.column(name).to_numpy(zero_copy_only=False) for name in frames.schema.names}
    index = RowIndex(
        bytes(parts[_RECORDING_ID]).decode(),
        int(parts[_BODY_CRC32]),
        {
            name: IndexedChunks(messages[of_entity], rows[of_entity], bool(in_order[of_entity].all()))
            for number, name in enumerate(chunks.column("entity").dictionary.to_pylist())
            if (of_entity := numbers == number).any()
        },
        FrameTable(
            columns["step"],
            columns["stamp"],
            np.stack([columns[f"odometry_{axis}"] for axis in _AXES], axis=1),
            np.stack([columns[f"exact_{axis}"] for axis in _AXES], axis=1),
            columns["has_original"],
        ),
    )
    if (messages < 0).any() or (rows < 0).any() or (rows > file_bytes).any() or not _is_complete(index):
        raise ValueError("an index that contradicts itself")
    return index


def _is_complete(index: RowIndex) -> bool:
    """Tell whether each frame has its images."""
    steps = {schema.RGB: len(index.frames.steps), schema.DEPTH: len(index.frames.steps)}
    steps[schema.ORIGINAL] = int(index.frames.has_original.sum())
    chunks = {entity: index.chunks.get(f"/{entity}") for entity in steps}
    return all(
        (0 if (each := chunks[entity]) is None else int(each.rows.sum())) == count for entity, count in steps.items()
    )
