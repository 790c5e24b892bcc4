"""Gathers the batches of a recording; joins the many small ones, and moves them to a memory-mapped temporary file.

A recording has four batches per second for each entity, and each costs ten kilobytes of memory. The images of eight
hours take gigabytes, but most are never read. Owns that file.
"""

import itertools
import mmap
import tempfile
from collections import defaultdict
from collections.abc import Iterator, Sequence

import pyarrow as pa

from ltvn_core.data.recording import schema

PART_BYTES = 2**26
"""Size in bytes of the parts in which batches are moved; a smaller recording stays in memory."""

_LONG = frozenset(f"/{entity}" for entity in (schema.RGB, schema.DEPTH, schema.ORIGINAL, schema.EVENTS))
"""Entities with so many rows that they are moved."""


class MappedBatches:
    """Collects the batches that are read back, of several entities."""

    def __init__(self) -> None:
        """Start without any batch."""
        self._rows: dict[str, list[pa.RecordBatch]] = defaultdict(list)
        self._part: dict[str, list[pa.RecordBatch]] = defaultdict(list)
        self._part_bytes = 0

    def append(self, entity: str, batch: pa.RecordBatch) -> None:
        """Append a batch to the batches of its entity, unless the entity is only drawn."""
        if entity not in _LONG:
            if schema.is_read_back(entity):
                self._rows[entity].append(batch)
            return
        self._part[entity].append(batch.replace_schema_metadata(None))  # The metadata refer to a single chunk only.
        self._part_bytes += batch.get_total_buffer_size()  # Ten times as fast as `nbytes`.
        if self._part_bytes >= PART_BYTES:
            self._close_part(move=True)

    def take(self) -> dict[str, list[pa.RecordBatch]]:
        """Return all rows of each entity in order, in fewer batches."""
        self._close_part(move=False)
        return self._rows

    def _close_part(self, *, move: bool) -> None:
        joined = {entity: list(_joined(batches)) for entity, batches in self._part.items()}
        self._part.clear()
        self._part_bytes = 0
        for entity, batches in joined.items():
            self._rows[entity] += _moved(batches) if move else batches


def _joined(batches: Sequence[pa.RecordBatch]) -> Iterator[pa.RecordBatch]:
    """Join neighbouring batches with the same columns."""
    for _, alike in itertools.groupby(batches, key=lambda batch: batch.schema):
        yield pa.concat_batches(list(alike))


def _moved(batches: Sequence[pa.RecordBatch]) -> Sequence[pa.RecordBatch]:
    """Return memory-mapped batches with the same content; the same batches if the disk is full."""
    try:
        with tempfile.TemporaryFile() as file:
            ends = list[int]()
            for batch in batches:
                with pa.ipc.new_stream(file, batch.schema) as writer:
                    writer.write_batch(batch)
                ends.append(file.tell())
            file.flush()
            mapped = pa.py_buffer(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
    except OSError:
        return batches
    return [
        pa.ipc.open_stream(mapped.slice(start, end - start)).read_next_batch()
        for start, end in itertools.pairwise([0, *ends])
    ]
