"""The bytes of a `.rrd` file (RRF2), as Rerun writes them: all that depends on Rerun's layout.

A file is a header of 12 bytes, messages, an end message, and a tail that points to it. A message with rows is an Arrow
table in a protobuf message; the end message begins with Rerun's footer, one table of chunks (manifest) for each store.
"""

import struct
from collections.abc import Iterable, Iterator
from functools import lru_cache
from typing import NamedTuple, Self, TypeAlias

import numpy as np
import pyarrow as pa
import xxhash
from numpy.typing import NDArray
from rerun.chunk import Chunk

from ltvn_core.data.recording import schema
from ltvn_core.data.recording.rrf2.arrow_tables import read_table, unpacked_lz4
from ltvn_core.protobuf_fields import bytes_field, bytes_fields, number_field, read_fields

FILE_MAGIC = b"RRF2"
"""First bytes of a file."""
HEADER_BYTES = 12
MESSAGE_HEADER = struct.Struct("<QQ")
"""Kind and length of the following payload."""
END_KIND, STORE_KIND, CHUNK_KIND = 0, 1, 2
KNOWN_KINDS = (STORE_KIND, CHUNK_KIND, 3)
"""Known kinds of messages: description of a store, chunk of rows, choice of a layout."""
RECORDING_STORE = b"\x08\x01"
"""Beginning of the key of a recording's store; that of the viewer's layout differs."""
_TAIL, _MARK = struct.Struct("<QQI8sI"), b"RRF2FOOT"
TAIL_BYTES = _TAIL.size
_FOOTER_SEED = 7850921
"""Rerun's seed for the checksum of its footer."""
_ENTITY = b"rerun:entity_path"
# Numbers of protobuf fields: of a message with rows, of the description of a store and its key, of the footer, of a
# manifest, and of its rows.
_CHUNK_STORE, _CHUNK_COMPRESSION, _CHUNK_SIZE, _CHUNK_TABLE = 1, 2, 3, 5
_STORE_INFO, _STORE_KEY = 2, 2
_RECORDING_ID = 2
_MANIFESTS = 1
_STORE, _SCHEMA, _SCHEMA_SHA256, _ROWS = 1, 2, 3, 4
_SCHEMA_BYTES = 1
_ENCODING, _PAYLOAD, _COMPRESSION, _SIZE = 1, 2, 3, 4
_ARROW, _LZ4 = 1, 2


MESSAGE_SUM = np.dtype([("kind", "<u4"), ("crc32", "<u4"), ("length", "<u8")])
"""Kind of a message, CRC-32 of its header and payload, and length of its payload in bytes, as closing records hold
them. An hour of recording has some sixty thousand messages."""
MessageSums: TypeAlias = NDArray[np.void]
"""(N,) of `MESSAGE_SUM`."""


def sizes_of(messages: MessageSums) -> NDArray[np.int64]:
    """Return the lengths (N,) of messages with their headers, in bytes."""
    return messages["length"].astype(np.int64) + MESSAGE_HEADER.size


class Tail(NamedTuple):
    """The last 32 bytes of a finished file."""

    footer_start: int
    """Position of the payload of the end message, in bytes."""
    footer_bytes: int
    """Size of Rerun's footer, in bytes; 0 if there is none."""
    footer_xxh32: int
    """Rerun's checksum of the footer."""

    @classmethod
    def of(cls, footer_start: int, footer: bytes) -> Self:
        """Return the tail of a file whose end message is at `footer_start` and begins with `footer`."""
        return cls(footer_start, len(footer), xxhash.xxh32_intdigest(footer, _FOOTER_SEED) if footer else 0)

    @classmethod
    def read(cls, data: bytes) -> Self | None:
        """Decode a tail; None if there is none."""
        if len(data) != TAIL_BYTES:
            return None
        tail = cls(*_TAIL.unpack(data)[:3])
        return tail if tail.encoded() == data else None

    def encoded(self) -> bytes:
        """Return the 32 bytes."""
        # Without a table, Rerun iterates over the messages.
        return _TAIL.pack(*self, _MARK, 1 if self.footer_bytes else 0)


def messages(block: bytes) -> Iterator[tuple[int, int, int]]:
    """Yield kind, begin and end of each message in a small file in memory, up to and including its end message."""
    begin, kind = HEADER_BYTES, -1
    while kind != END_KIND and begin + MESSAGE_HEADER.size <= len(block):
        kind, length = MESSAGE_HEADER.unpack_from(block, begin)
        end = begin + MESSAGE_HEADER.size + length
        yield kind, begin, end
        begin = end


class ChunkMessage(NamedTuple):
    """The rows of one message."""

    store: bytes
    """Rerun's key of the recording, or of the viewer's layout, to which the rows belong."""
    entity: str
    batch: pa.RecordBatch


UNREADABLE = (OSError, ValueError, LookupError, TypeError, pa.ArrowException)
"""What `read_chunk` raises."""


def read_chunk(payload: bytes) -> ChunkMessage:
    """Decode a message without its header; nothing in it is trusted. Raises one of `UNREADABLE` if it is no chunk."""
    fields = {each.number: each.value for each in read_fields(payload)}
    store, table, size = fields[_CHUNK_STORE], fields[_CHUNK_TABLE], fields.get(_CHUNK_SIZE, 0)
    batch = _read_batch(table, size, is_packed=fields.get(_CHUNK_COMPRESSION) == _LZ4)
    if not isinstance(store, bytes):
        raise TypeError("its layout is unknown")
    _ = recording_id(store), batch.schema.names  # Whoever reads them later expects texts.
    entity = (batch.schema.metadata or {})[_ENTITY].decode()
    if store.startswith(RECORDING_STORE) and schema.is_of_user(entity):
        _require_texts(batch.schema)
        Chunk.from_record_batch(batch)
    return ChunkMessage(store, entity, batch)


def _require_texts(fields: Iterable[pa.Field]) -> None:
    """Raise ValueError if a name or a note is no text: Rerun, which gets a user's rows back, ends the process on it."""
    for field in fields:
        _ = field.name, [(key.decode(), value.decode()) for key, value in (field.metadata or {}).items()]
        _require_texts(field.type.field(number) for number in range(field.type.num_fields))


def described_store(payload: bytes) -> bytes:
    """Return the key of the store that a message describes. Raises ValueError or LookupError if it has none."""
    return bytes_fields(bytes_fields(payload)[_STORE_INFO])[_STORE_KEY]


@lru_cache
def recording_id(store: bytes) -> str:
    """Return the id of the recording in the key of a store. Raises ValueError or LookupError if it has none."""
    return bytes_fields(store)[_RECORDING_ID].decode()


class Manifest(NamedTuple):
    """Rerun's table of the chunks of one store."""

    store: bytes
    schema: bytes
    """Schema of all columns of the store, as an Arrow message."""
    schema_sha256: bytes
    """Message with Rerun's checksum of the schema."""
    chunks: pa.RecordBatch
    """One row a chunk."""

    def encoded(self) -> bytes:
        """Return the manifest as a field of the footer."""
        # Written once to count the bytes, so that the memory of a long table has the right size.
        counted = pa.MockOutputStream()
        _write(self.chunks, counted)
        stream = pa.allocate_buffer(counted.size())
        _write(self.chunks, pa.FixedSizeBufferWriter(stream))
        packed = bytes_field(_PAYLOAD, pa.Codec("lz4_raw").compress(stream, asbytes=True))
        rows = number_field(_ENCODING, _ARROW) + packed + number_field(_COMPRESSION, _LZ4)
        schema = bytes_field(_SCHEMA_BYTES, self.schema)
        fields = {_STORE: self.store, _SCHEMA: schema, _SCHEMA_SHA256: self.schema_sha256}
        fields[_ROWS] = rows + number_field(_SIZE, len(stream))
        return bytes_field(_MANIFESTS, b"".join(bytes_field(*each) for each in fields.items()))


def read_manifests(footer: bytes) -> Iterator[Manifest]:
    """Decode Rerun's footer. Raises OSError, ValueError, LookupError, TypeError or ArrowException."""
    for number, manifest in read_fields(footer):
        if number == _MANIFESTS and isinstance(manifest, bytes):
            parts = bytes_fields(manifest)
            rows = {field.number: field.value for field in read_fields(parts[_ROWS])}
            chunks = _read_batch(rows[_PAYLOAD], rows.get(_SIZE, 0), is_packed=rows.get(_COMPRESSION) == _LZ4)
            yield Manifest(parts[_STORE], bytes_fields(parts[_SCHEMA])[_SCHEMA_BYTES], parts[_SCHEMA_SHA256], chunks)


def _read_batch(table: bytes | int, size: bytes | int, *, is_packed: bool) -> pa.RecordBatch:
    if not isinstance(table, bytes) or not isinstance(size, int):
        raise TypeError("its layout is unknown")
    stream = unpacked_lz4(table, size) if is_packed else table
    return read_table(stream, len(stream))


def _write(batch: pa.RecordBatch, sink: pa.NativeFile) -> None:
    with pa.ipc.new_stream(sink, batch.schema) as writer:
        writer.write_batch(batch)
