"""Makes the best of a message that is damaged: puts a single flipped bit right, or what is left into a new message.

Owns the arithmetic of the checksum and the layout of the messages that hold rows. Without a checksum of the message
nobody knows which of its rows are right; whoever reads them compares the checksums of their own.
"""

import re
import zlib
from collections.abc import Iterator
from typing import NamedTuple

from ltvn_core.protobuf_fields import bytes_field, number_field
from ltvn_core.recording import lz4_block
from ltvn_core.recording.rrd_framing import CHUNK_KIND, MESSAGE_HEADER

_STORE, _COMPRESSION, _SIZE, _ENCODING, _TABLE, _CHUNK_ID = 1, 2, 3, 4, 5, 6
_UNCOMPRESSED = 1
_ARROW = 1
_TABLE_START = re.compile(rb"\x18(?P<size>[\x80-\xff]{0,5}[\0-\x7f])\x20\x01\x2a(?P<length>[\x80-\xff]{0,5}[\0-\x7f])")
"""Size, encoding (Arrow) and the beginning of the table, which stand one behind the other."""
_BEFORE_TABLE = 256
"""All of these stand in so many bytes at the beginning of a message."""
_POLYNOMIAL = 0xEDB88320


def _crc_of_byte(byte: int) -> int:
    for _ in range(8):
        byte = byte >> 1 ^ (_POLYNOMIAL if byte & 1 else 0)
    return byte


_CRC_TABLE = tuple(map(_crc_of_byte, range(256)))
_INDEX_OF_TOP = {crc >> 24: index for index, crc in enumerate(_CRC_TABLE)}
_BIT_OF_CRC = {_CRC_TABLE[1 << bit]: bit for bit in range(8)}


def with_bit_put_right(message: bytes, crc32: int) -> bytes | None:
    """Return a message that was written with the checksum `crc32` and of which one bit flipped; None for all else.

    What a flipped bit changes in the checksum depends on its place alone, and on no two places it is the same. Damage
    of another kind looks like a flipped bit once in 500 million for each byte of the message.
    """
    changed = zlib.crc32(message) ^ crc32
    for place in range(len(message) - 1, -1, -1):
        bit = _BIT_OF_CRC.get(changed)
        if bit is not None:
            mended = message[:place] + bytes([message[place] ^ 1 << bit]) + message[place + 1 :]
            return mended if zlib.crc32(mended) == crc32 else None
        # One byte of zeros less behind the change.
        index = _INDEX_OF_TOP[changed >> 24]
        changed = (changed ^ _CRC_TABLE[index]) << 8 & 0xFFFFFFFF | index
    return None


def readable_again(message: bytes, store: bytes) -> Iterator[bytes]:
    """Yield messages of `store` that hold what is left of the table in a damaged one; the likeliest first."""
    payload = message[MESSAGE_HEADER.size :]
    found = _table(payload)
    if found is None:
        return
    packed = len(found.table) != found.size
    tables = lz4_block.decompressed(found.table, found.size) if packed else (found.table,)
    for table in tables:
        rows = b"".join(
            (
                bytes_field(_STORE, store),
                number_field(_COMPRESSION, _UNCOMPRESSED),
                number_field(_SIZE, len(table)),
                number_field(_ENCODING, _ARROW),
                bytes_field(_TABLE, table),
                bytes_field(_CHUNK_ID, found.chunk_id),
            )
        )
        yield MESSAGE_HEADER.pack(CHUNK_KIND, len(rows)) + rows


class _Table(NamedTuple):
    table: bytes
    size: int
    """Bytes that it has decompressed."""
    chunk_id: bytes


def _table(payload: bytes) -> _Table | None:
    """Find the table in a message that may be cut, or damaged before and behind the table."""
    found = _TABLE_START.search(payload, 0, _BEFORE_TABLE)
    if found is None:
        return None
    begin, length = found.end(), _number(found["length"])
    chunk_id = b"\t" + zlib.crc32(payload).to_bytes(8, "little") + b"\x11" + len(payload).to_bytes(8, "little")
    return _Table(payload[begin : begin + length], _number(found["size"]), chunk_id)


def _number(encoded: bytes) -> int:
    return sum((byte & 0x7F) << 7 * place for place, byte in enumerate(encoded))
