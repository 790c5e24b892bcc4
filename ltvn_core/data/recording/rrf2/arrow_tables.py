"""Reads Arrow tables of untrusted files within a limit of memory, because a few bytes can unpack to gigabytes.

Owns the part of Arrow's message layout (a flatbuffer) that tells the sizes of its buffers before they are unpacked.
"""

import struct

import pyarrow as pa

_LZ4_RATIO = 255
"""Largest compression ratio of LZ4."""
_HEADER, _DICTIONARY, _BUFFERS, _COMPRESSION = 2, 1, 2, 3
"""Numbers of fields: in a message its header; in a dictionary its rows; in rows their buffers, and how they are
compressed."""
_CODEC = pa.Codec("lz4_raw")


def read_table(stream: bytes, most_bytes: int) -> pa.RecordBatch:
    """Return the only batch of an Arrow stream, with valid offsets.

    Raises ValueError or ArrowException if it is none, or unpacks to more than `most_bytes`.
    """
    try:
        messages = list(pa.ipc.MessageReader.open_stream(stream))
        size = sum(map(_unpacked_bytes, messages))
    except struct.error as error:
        raise ValueError("an Arrow table with another layout") from error
    if size > most_bytes:
        raise ValueError(f"a table that unpacks to {size:,} bytes, more than the {most_bytes:,} that are possible")
    if [message.type for message in messages] == ["schema", "record batch"]:  # Decoded without a look at it again.
        table = pa.ipc.read_record_batch(messages[1], pa.ipc.read_schema(messages[0]))
    else:
        (table,) = pa.ipc.open_stream(stream)
    table.validate(full=True)
    return table


def unpacked_lz4(packed: bytes, size: int) -> bytes:
    """Decompress a block of LZ4 to `size` bytes. Raises ValueError or ArrowException if it cannot have this size."""
    if not 0 <= size <= _LZ4_RATIO * len(packed):
        raise ValueError("a block that is larger than LZ4 can compress")
    return _CODEC.decompress(packed, size, asbytes=True)


def _unpacked_bytes(message: pa.Message) -> int:
    """Return the size of the rows, or of the dictionary, in a message; 0 for a schema."""
    if message.type not in ("record batch", "dictionary"):
        return 0
    metadata, body = memoryview(message.metadata), memoryview(message.body)
    header = _pointed(metadata, _field(metadata, _pointed(metadata, 0), _HEADER))
    if message.type == "dictionary":
        header = _pointed(metadata, _field(metadata, header, _DICTIONARY))
    if not _field(metadata, header, _COMPRESSION):
        return len(body)
    buffers = _pointed(metadata, _field(metadata, header, _BUFFERS))
    (count,) = struct.unpack_from("<I", metadata, buffers)
    places = struct.unpack_from(f"<{2 * min(count, len(metadata))}q", metadata, buffers + 4)
    total = 0
    for offset, length in zip(places[::2], places[1::2], strict=True):
        # The unpacked size stands before each packed buffer; -1 if it is not packed.
        size = 0 if length == 0 else struct.unpack_from("<q", body, offset)[0]
        total += length if size < 0 else size
    return total


def _pointed(data: memoryview, place: int) -> int:
    """Return the place to which the offset at `place` points."""
    return place + struct.unpack_from("<I", data, place)[0]


def _field(data: memoryview, table: int, number: int) -> int:
    """Return the place of a field of a table; 0 if the table has no such field."""
    places = table - struct.unpack_from("<i", data, table)[0]
    (size,) = struct.unpack_from("<H", data, places)
    at = 4 + 2 * number
    offset = struct.unpack_from("<H", data, places + at)[0] if at < size else 0
    return table + offset if offset else 0
