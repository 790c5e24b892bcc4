"""Moves the images of a long recording out of memory into a temporary file, which is memory-mapped.

Eight hours of images take gigabytes, of which hardly any are looked at. Owns that file.
"""

import mmap
import tempfile
from contextlib import suppress
from typing import NamedTuple

import pyarrow as pa

PART_BYTES = 2**26
"""Batches are moved in parts of this size, so a recording with fewer bytes of images stays in memory."""


class _Place(NamedTuple):
    """A place in a list of batches."""

    rows: list[pa.RecordBatch]
    place: int


class MappedBatches:
    """Appends batches to lists, and later replaces them there by memory-mapped ones with the same content."""

    def __init__(self) -> None:
        """Start with an empty part."""
        self._part: list[_Place] = []
        self._bytes = 0

    def append(self, rows: list[pa.RecordBatch], batch: pa.RecordBatch) -> None:
        """Append a batch to `rows`. If the disk is full, the batches stay in memory."""
        self._part.append(_Place(rows, len(rows)))
        rows.append(batch)
        self._bytes += batch.nbytes
        if self._bytes < PART_BYTES:
            return
        with suppress(OSError):
            self._move()
        self._part.clear()
        self._bytes = 0

    def _move(self) -> None:
        with tempfile.TemporaryFile() as file:
            ends = list[int]()
            for rows, place in self._part:
                # Each batch has a schema of its own: its metadata hold the id of its chunk.
                with pa.ipc.new_stream(file, rows[place].schema) as writer:
                    writer.write_batch(rows[place])
                ends.append(file.tell())
            file.flush()
            mapped = pa.py_buffer(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
        for (rows, place), start, end in zip(self._part, [0, *ends], ends, strict=False):
            rows[place] = pa.ipc.open_stream(mapped.slice(start, end - start)).read_next_batch()
