"""Rows of a recording with a checksum of their own, and whether each row is unchanged.

Owns which columns a checksum covers. Independent of files, and of frames with more than one row.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.data.recording import schema
from ltvn_core.data.recording.event_codec import EncodedEvent, current_kind
from ltvn_core.data.recording.frame_codec import EncodedFrame
from ltvn_core.data.recording.schema import read_cell
from ltvn_core.errors import CameraError
from ltvn_core.structured_text import parse_json
from ltvn_core.types import OriginalImage, Tilt


class StoredEvent(NamedTuple):
    """An event as JSON, with the checksum that was stored with it."""

    event: EncodedEvent
    checksum: int

    @property
    def intact(self) -> bool:
        """Whether the data is unchanged."""
        return self.checksum == self.event.checksum


class BatchRow(NamedTuple):
    """One row of a batch."""

    batch: pa.RecordBatch
    row: int

    @property
    def step(self) -> int:
        """Control step of the row."""
        return self.batch.column(schema.STEP)[self.row].as_py()

    def numbers(self, column: str) -> NDArray:
        """Return the numbers of a column."""
        return read_cell(self.batch.column(column), self.row)

    def blob(self, column: str) -> bytes | None:
        """Return the bytes of a column, which may be missing or empty."""
        if self.batch.schema.get_field_index(column) < 0:
            return None
        return self.numbers(column).tobytes() or None

    def checksum(self, archetype: str) -> int:
        """Return the checksum that was stored with the row."""
        return int(self.numbers(f"{archetype}:crc32")[0])


def stored_events(batch: pa.RecordBatch) -> list[StoredEvent]:
    """Return the events of a batch, still as JSON."""
    names = ("sequence", "stamp", "kind", "json", "crc32")
    columns = [batch.column(f"{schema.EVENT_ROW}:{name}").flatten().to_pylist() for name in names]
    steps = batch.column(schema.STEP).to_pylist()
    return [
        StoredEvent(EncodedEvent(sequence, step, stamp, current_kind(kind), text), checksum)
        for step, sequence, stamp, kind, text, checksum in zip(steps, *columns, strict=True)
    ]


def frame_of(rgb: BatchRow, depth: BatchRow | None, original: BatchRow | None) -> EncodedFrame:
    """Assemble a frame from its rows. Raises LookupError, ValueError or CameraError if a row is damaged."""
    exact = rgb.numbers(f"{schema.FRAME_ROW}:exact_pose")
    return EncodedFrame(
        step=rgb.step,
        stamp=float(rgb.numbers(f"{schema.FRAME_ROW}:stamp")[0]),
        odometry=rgb.numbers(f"{schema.FRAME_ROW}:odometry").copy(),
        exact_pose=exact.copy() if exact.size else None,
        rgb=rgb.numbers("EncodedImage:blob").tobytes(),
        depth=None if depth is None else depth.blob(schema.DEPTH_PICTURE),
        original=None if original is None else _original_image(original),
        tilt=_tilt(rgb),
    )


def damaged_first(path: str, batches: Sequence[pa.RecordBatch]) -> Sequence[pa.RecordBatch]:
    """Order the rows of an entity so that an intact row comes after damaged rows of the same step.

    Damaged rows of original images are left out, because a frame is usable without its original image.
    """
    entity = path.removeprefix("/")
    if entity not in schema.COLUMNS:
        return batches
    others, damaged, right = _by_checksum(entity, batches)
    return [*others, *([] if entity == schema.ORIGINAL else damaged), *right]


def believable(path: str, batches: Sequence[pa.RecordBatch]) -> Sequence[pa.RecordBatch]:
    """Return the rows of damaged tables that match their own checksums."""
    entity = path.removeprefix("/")
    return _by_checksum(entity, batches)[-1] if entity in schema.COLUMNS else ()


def _by_checksum(entity: str, batches: Sequence[pa.RecordBatch]) -> Sequence[Sequence[pa.RecordBatch]]:
    """Return the batches that lack a column, and of the others the damaged rows and the intact ones."""
    masks = [(batch, _intact_rows(entity, batch)) for batch in batches]
    damaged = [batch.filter(pa.array(~intact)) for batch, intact in masks if len(intact)]
    right = [batch.filter(pa.array(intact)) for batch, intact in masks if len(intact)]
    others = [batch for batch, intact in masks if not len(intact)]
    return [[batch for batch in each if batch.num_rows] for each in (others, damaged, right)]


def _intact_rows(entity: str, batch: pa.RecordBatch) -> NDArray[np.bool_]:
    """Tell for each row whether it matches its own checksum, (N,); (0,) if a column is missing."""
    if not schema.COLUMNS[entity].keys() <= set(batch.schema.names):
        return np.empty(0, bool)
    if entity == schema.EVENTS:
        return np.array([_event_is_intact(batch.slice(row, 1)) for row in range(batch.num_rows)], bool)
    return np.array([_is_intact(entity, BatchRow(batch, row)) for row in range(batch.num_rows)], bool)


def _is_intact(entity: str, row: BatchRow) -> bool:
    try:
        match entity:
            case schema.RGB:
                return frame_of(row, None, None).rgb_checksum == row.checksum(schema.FRAME_ROW)
            case schema.DEPTH:
                return depth_checksum(row) == row.checksum(schema.DEPTH_ROW)
            case schema.ORIGINAL:
                return original_checksum(row) == row.checksum(schema.ORIGINAL_ROW)
            case _:
                return False
    except (LookupError, ValueError, TypeError, CameraError):
        return False


def depth_checksum(row: BatchRow) -> int:
    """Return the checksum that a depth row should have."""
    return replace(_NOTHING, step=row.step, depth=row.blob(schema.DEPTH_PICTURE)).depth_checksum


def original_checksum(row: BatchRow) -> int:
    """Return the checksum that the row of an original picture should have."""
    return replace(_NOTHING, step=row.step, original=_original_image(row)).original_checksum


_NOTHING = EncodedFrame(step=0, stamp=0.0, odometry=np.zeros(3), exact_pose=None, rgb=b"", depth=None)


def _event_is_intact(batch: pa.RecordBatch) -> bool:
    try:
        (stored,) = stored_events(batch)
    except (LookupError, ValueError, TypeError):
        return False
    return stored.intact


def _original_image(row: BatchRow) -> OriginalImage:
    camera = row.batch.column(f"{schema.ORIGINAL_ROW}:camera")[row.row].as_py()[0]
    return OriginalImage(row.numbers("EncodedImage:blob").tobytes(), CameraModel.from_json(parse_json(camera)))


def _tilt(rgb: BatchRow) -> Tilt | None:
    """Return the tilt of the camera; None in older recordings, and if the tilt equals the mounting."""
    column = f"{schema.FRAME_ROW}:tilt"
    if rgb.batch.schema.get_field_index(column) < 0 or (numbers := rgb.numbers(column)).size != len(Tilt._fields):
        return None
    return Tilt(*map(float, numbers))
