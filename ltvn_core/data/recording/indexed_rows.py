"""Reads the messages of a checked file one at a time, and with an index only when their rows are asked for.

Owns the file that stays open for this. Each message is compared with
its checksum, because the file may have changed since it was opened, and with what the index promises of it.
"""

import os
import threading
import weakref
import zlib
from collections.abc import Iterator, Mapping, Sequence, Set
from functools import lru_cache
from pathlib import Path
from typing import overload

import numpy as np
import pyarrow as pa

from ltvn_core.data.recording import schema
from ltvn_core.data.recording.rrf2.layout import (
    CHUNK_KIND,
    HEADER_BYTES,
    MESSAGE_HEADER,
    STORE_KIND,
    UNREADABLE,
    ChunkMessage,
    MessageSums,
    described_store,
    read_chunk,
    recording_id,
    sizes_of,
)
from ltvn_core.data.recording.rrf2.row_index import IndexedChunks, RowIndex
from ltvn_core.errors import RecordingError

_KEPT = 8
"""Number of messages of an entity that stay in memory, for neighbouring rows."""
_IN_MEMORY_BYTES = 2**26
"""Size of the largest file that is read at once, so that it need not stay open."""


class IndexedBatches(Sequence[pa.RecordBatch]):
    """The batches of one entity, each read when it is asked for."""

    def __init__(self, messages: "FileMessages", recording_id: str, entity: str, chunks: IndexedChunks) -> None:
        """Take the file's messages, and the chunks of the entity."""
        self._messages = messages
        self._promised = recording_id, entity
        self._numbers = list(zip(chunks.messages.tolist(), chunks.rows.tolist(), strict=True))
        self._read = lru_cache(_KEPT)(self._batch)

    def __len__(self) -> int:
        """Return the number of batches."""
        return len(self._numbers)

    @overload
    def __getitem__(self, place: int) -> pa.RecordBatch: ...
    @overload
    def __getitem__(self, place: slice) -> Sequence[pa.RecordBatch]: ...
    def __getitem__(self, place: int | slice) -> pa.RecordBatch | Sequence[pa.RecordBatch]:
        """Read a batch, or several. Raises RecordingError if the file has changed."""
        if isinstance(place, slice):
            return [self._read(*number) for number in self._numbers[place]]
        return self._read(*self._numbers[place])

    def _batch(self, number: int, rows: int) -> pa.RecordBatch:
        """Decode the message of this number, which has so many rows. Raises RecordingError."""
        try:
            store, entity, batch = self._messages.chunk(number)
            found = recording_id(store), entity
            if (*found, batch.num_rows) != (*self._promised, rows):
                raise ValueError(f"it has {batch.num_rows} rows of {entity} in recording {found[0]}")
            if not schema.has_expected_columns(entity, batch):
                raise ValueError(f"a column of {entity} is missing or has another type")
            return batch
        except UNREADABLE as error:
            path = self._messages.path
            raise RecordingError(
                f"{path} changed after it was opened, or has a wrong index: message {number} cannot be read "
                f"({error}). Open it again, or run `ltvn repair {path} --output NEW.rrd`."
            ) from error


def indexed_batches(messages: "FileMessages", index: RowIndex) -> Mapping[str, IndexedBatches]:
    """Return the batches of a checked file, by entity path."""
    return {
        entity: IndexedBatches(messages, index.recording_id, entity, chunks) for entity, chunks in index.chunks.items()
    }


class FileMessages:
    """The messages of a file, which stays open if it is large."""

    def __init__(self, path: Path, sums: MessageSums) -> None:
        """Open a file with these messages. Raises OSError if that is impossible."""
        self.path = path
        self._sums = sums
        self._places = HEADER_BYTES + np.concatenate([[0], np.cumsum(sizes_of(sums))])
        self._bytes = path.read_bytes() if path.stat().st_size <= _IN_MEMORY_BYTES else None
        self._lock = threading.Lock()
        if self._bytes is None:
            self._file = os.open(path, os.O_RDONLY | getattr(os, "O_BINARY", 0))
            weakref.finalize(self, os.close, self._file)

    def stores(self) -> Set[bytes]:
        """Return the keys of the stores that the file describes. Raises one of `UNREADABLE`."""
        return {described_store(self._payload(number)) for number in self._of_kind(STORE_KIND)}

    def chunks(self) -> Iterator[ChunkMessage]:
        """Yield all messages with rows. Raises one of `UNREADABLE`."""
        return (self.chunk(number) for number in self._of_kind(CHUNK_KIND))

    def chunk(self, number: int) -> ChunkMessage:
        """Decode the message of this number. Raises one of `UNREADABLE`."""
        return read_chunk(self._payload(number))

    def _of_kind(self, kind: int) -> Sequence[int]:
        return np.flatnonzero(self._sums["kind"] == kind).tolist()

    def _payload(self, number: int) -> bytes:
        place, after = self._places[number : number + 2].tolist()
        if self._bytes is not None:
            data = self._bytes[place:after]
        else:
            with self._lock:  # Windows cannot read at a position without moving there.
                os.lseek(self._file, place, os.SEEK_SET)
                data = os.read(self._file, after - place)
        if zlib.crc32(data) != self._sums["crc32"][number]:
            raise ValueError("its checksum differs")
        return data[MESSAGE_HEADER.size :]
