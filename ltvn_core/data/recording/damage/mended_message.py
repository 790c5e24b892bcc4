"""Recovers a damaged message: corrects a single flipped bit, or puts the remaining rows into a new message.

Owns the arithmetic of the checksum, the layout of messages with rows, and the decompression of damaged LZ4 blocks. If
the checksum of a message does not match, it is unknown which of its rows are correct; the reader then compares the
rows' own checksums.
"""

import re
import zlib
from collections.abc import Iterator
from typing import NamedTuple

from ltvn_core.data.recording.rrf2.framing import CHUNK_KIND, MESSAGE_HEADER
from ltvn_core.protobuf_fields import bytes_field, number_field

_LONG = 15
"""Value of a four-bit length that continues in the next bytes."""
_SHORTEST_MATCH = 4
_MOST_RATIO = 255
"""Largest compression ratio of an LZ4 block."""
_MOST_BYTES = 1 << 30
_SHIFTS = 8
_STORE = 1
_COMPRESSION = 2
_SIZE = 3
_ENCODING = 4
_TABLE = 5
_CHUNK_ID = 6
_UNCOMPRESSED = 1
_ARROW = 1
_TABLE_START = re.compile(rb"\x18(?P<size>[\x80-\xff]{0,5}[\0-\x7f])\x20\x01\x2a(?P<length>[\x80-\xff]{0,5}[\0-\x7f])")
"""Bytes before the table: its size, its encoding (Arrow), and its length."""
_BEFORE_TABLE = 256
"""Number of bytes at the beginning of a message in which these fields are searched."""
_POLYNOMIAL = 0xEDB88320


class _Sequence(NamedTuple):
    """A sequence of LZ4: literal bytes, and then a repetition of earlier output."""

    literals: bytes
    back: int
    """Distance back to the bytes that are repeated; 0 in the last sequence."""
    match: int
    """Number of bytes that are repeated."""


def decompressed(block: bytes, size: int) -> Iterator[bytes]:
    """Yield possible contents of a damaged block, `size` bytes each; the most likely first.

    A damaged length shifts all bytes after it. So if the total size is wrong, the bytes after several places are tried
    at their original position.
    """
    if not 0 < size <= min(_MOST_BYTES, _MOST_RATIO * len(block)):
        return
    sequences = list[_Sequence]()
    total = 0
    for sequence in _sequences(block):
        sequences.append(sequence)
        total += len(sequence.literals) + sequence.match
        if total > 2 * size + _MOST_RATIO:
            break  # A damaged length that is far too large.
    yield _joined(sequences, size, len(sequences), 0)
    if total != size and len(sequences) > 1:
        for part in range(1, _SHIFTS):
            yield _joined(sequences, size, part * len(sequences) // _SHIFTS, size - total)


def _joined(sequences: list[_Sequence], size: int, moved_from: int, by: int) -> bytes:
    """Return the output of sequences; those from number `moved_from` on are shifted by `by` bytes."""
    out = bytearray(size)
    place = 0
    for number, (literals, back, match) in enumerate(sequences):
        if number == moved_from:
            place = max(0, place + by)
        if place >= size:
            break
        fitting = literals[: size - place]
        out[place : place + len(fitting)] = fitting
        place += len(literals)
        if 0 < back <= place < size:
            _repeat(out, place, back, min(match, size - place))
        place += match
    return bytes(out)


def _repeat(out: bytearray, place: int, back: int, count: int) -> None:
    repeated = out[place - back : min(place - back + count, place)]
    out[place : place + count] = (repeated * (count // len(repeated) + 1))[:count]


def _sequences(block: bytes) -> Iterator[_Sequence]:
    """Yield the sequences of a block; if it is damaged, the last sequence may be incomplete."""
    place = 0
    while place < len(block):
        token = block[place]
        count, place = _length(block, place + 1, token >> 4)
        literals = block[place : place + count]
        place += count
        if place + 2 > len(block):
            yield _Sequence(literals, 0, 0)
            return
        back = int.from_bytes(block[place : place + 2], "little")
        match, place = _length(block, place + 2, token & _LONG)
        yield _Sequence(literals, back, match + _SHORTEST_MATCH)


def _length(block: bytes, place: int, length: int) -> tuple[int, int]:
    """Return a length whose first four bits are `length`, and the position after it."""
    if length < _LONG:
        return length, place
    while place < len(block):
        more = block[place]
        length = length + more
        place = place + 1
        if more < _MOST_RATIO:
            break
    return length, place


def _crc_of_byte(byte: int) -> int:
    for _ in range(8):
        byte = byte >> 1 ^ (_POLYNOMIAL if byte & 1 else 0)
    return byte


_CRC_TABLE = tuple(map(_crc_of_byte, range(256)))

_INDEX_OF_TOP = {crc >> 24: index for index, crc in enumerate(_CRC_TABLE)}

_BIT_OF_CRC = {_CRC_TABLE[1 << bit]: bit for bit in range(8)}


def with_bit_put_right(message: bytes, crc32: int) -> bytes | None:
    """Return the original of a message with the checksum `crc32` in which a single bit flipped; None for other damage.

    The change of the checksum depends only on the position of the flipped bit, and is different for every position.
    Other damage looks like a flipped bit with a probability of 1 in 500 million per byte of the message.
    """
    changed = zlib.crc32(message) ^ crc32
    for place in range(len(message) - 1, -1, -1):
        bit = _BIT_OF_CRC.get(changed)
        if bit is not None:
            mended = message[:place] + bytes([message[place] ^ 1 << bit]) + message[place + 1 :]
            return mended if zlib.crc32(mended) == crc32 else None
        # Remove one zero byte after the change from the checksum.
        index = _INDEX_OF_TOP[changed >> 24]
        changed = (changed ^ _CRC_TABLE[index]) << 8 & 0xFFFFFFFF | index
    return None


def readable_again(message: bytes, store: bytes) -> Iterator[bytes]:
    """Yield new messages of `store` with the remains of the table in a damaged message; the most likely first."""
    payload = message[MESSAGE_HEADER.size :]
    found = _table(payload)
    if found is None:
        return
    packed = len(found.table) != found.size
    tables = decompressed(found.table, found.size) if packed else (found.table,)
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
    """Size of the decompressed table in bytes."""
    chunk_id: bytes


def _table(payload: bytes) -> _Table | None:
    """Find the table in a message that may be cut off, or damaged before and after the table."""
    found = _TABLE_START.search(payload, 0, _BEFORE_TABLE)
    if found is None:
        return None
    begin = found.end()
    length = _number(found["length"])
    chunk_id = b"\t" + zlib.crc32(payload).to_bytes(8, "little") + b"\x11" + len(payload).to_bytes(8, "little")
    return _Table(payload[begin : begin + length], _number(found["size"]), chunk_id)


def _number(encoded: bytes) -> int:
    return sum((byte & 0x7F) << 7 * place for place, byte in enumerate(encoded))
