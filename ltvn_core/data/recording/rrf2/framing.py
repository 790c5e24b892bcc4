"""The outer structure of a `.rrd` file: a header, messages with their lengths, an end message, and a tail pointing to
it.

Owns iterating over the messages, in plain Python, so that a file can be checked before Rerun's reader reads a byte of
it. Does not interpret messages.
"""

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple, Self

import xxhash

HEADER_BYTES = 12
MESSAGE_HEADER = struct.Struct("<QQ")
"""Kind and length of the following payload."""
END_KIND = 0
CHUNK_KIND = 2
KNOWN_KINDS = (1, CHUNK_KIND, 3)
"""Known kinds of messages: description of a store, chunk of rows, choice of a layout."""
_FOOTER_SEED = 7850921
"""Rerun's seed for the checksum of its table of chunks."""
FILE_MAGIC = b"RRF2"
"""First bytes of a file."""
_TAIL = struct.Struct("<QQI8sI")
TAIL_BYTES = _TAIL.size
_MARK = b"RRF2FOOT"
_MARK_BYTES = 12
"""Distance of the closing mark from the end of the file, in bytes."""


class MessageSum(NamedTuple):
    """Checksum and length of a message in a file."""

    kind: int
    length: int
    """Length of the payload, in bytes."""
    crc32: int
    """CRC-32 of the message's header and payload."""

    @property
    def size(self) -> int:
        """Length with the message's header, in bytes."""
        return MESSAGE_HEADER.size + self.length

    @property
    def header(self) -> bytes:
        """The 16 bytes before the payload."""
        return MESSAGE_HEADER.pack(self.kind, self.length)


class Tail(NamedTuple):
    """The last 32 bytes of a finished file."""

    footer_start: int
    """Position of the payload of the end message, in bytes."""
    footer_bytes: int
    """Size of Rerun's own table of all chunks, in bytes; 0 if there is none."""
    footer_xxh32: int
    """Rerun's checksum of that table."""

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
        tables = 1 if self.footer_bytes else 0
        return _TAIL.pack(*self, _MARK, tables)


class RrdFraming(NamedTuple):
    """Result of checking how much of a file is complete."""

    messages: int
    """Number of complete messages, without the end message."""
    whole_bytes: int
    """Length of the header and the complete messages, in bytes."""
    finished: bool
    """Whether the end message was reached, and is followed by the tail and the end of the file."""


def is_rrd(path: Path) -> bool:
    """Tell whether a file begins like a Rerun file."""
    with path.open("rb") as file:
        return file.read(len(FILE_MAGIC)) == FILE_MAGIC


def is_finished(path: Path) -> bool:
    """Tell quickly whether the closing mark is at the end of the file."""
    with path.open("rb") as file:
        size = file.seek(0, 2)
        file.seek(max(0, size - _MARK_BYTES))
        return file.read(len(_MARK)) == _MARK


def walk_messages(file: BinaryIO, size: int) -> Iterator[MessageSum]:
    """Yield the messages of a file of `size` bytes, up to its end message or the first place that is not a message.

    Reads all bytes. Keeps its own position, so that callers may move the file's position between two messages.
    """
    position = HEADER_BYTES
    while position + MESSAGE_HEADER.size <= size:
        file.seek(position)
        header = file.read(MESSAGE_HEADER.size)
        kind, length = MESSAGE_HEADER.unpack(header)
        position += MESSAGE_HEADER.size + length
        if kind not in KNOWN_KINDS or position > size:
            return
        yield MessageSum(kind, length, checksum(file, length, zlib.crc32(header)))


class EndMessage(NamedTuple):
    """The message that closes a file."""

    position: int
    """Position of its beginning, in bytes."""
    payload: bytes
    tail: Tail

    @property
    def footer(self) -> bytes:
        """Rerun's own table of all chunks."""
        return self.payload[: self.tail.footer_bytes]

    @property
    def footer_is_right(self) -> bool:
        """Whether Rerun's table is unchanged. Takes 0.14 s per megabyte of the table."""
        return self.tail == Tail.of(self.tail.footer_start, self.footer)

    @property
    def appended(self) -> bytes:
        """Return the bytes after Rerun's table, which Rerun skips."""
        return self.payload[self.tail.footer_bytes :]

    def encoded(self) -> bytes:
        """Return everything from the end message to the end of the file."""
        return MESSAGE_HEADER.pack(END_KIND, len(self.payload)) + self.payload + self.tail.encoded()


def read_end(file: BinaryIO, position: int, size: int) -> EndMessage | None:
    """Return the end message, if it is at `position` and is followed only by the tail; else None."""
    file.seek(position)
    header = file.read(MESSAGE_HEADER.size)
    if len(header) < MESSAGE_HEADER.size:
        return None
    kind, length = MESSAGE_HEADER.unpack(header)
    if kind != END_KIND or position + MESSAGE_HEADER.size + length + TAIL_BYTES != size:
        return None
    payload = file.read(length)
    tail = Tail.read(file.read(TAIL_BYTES))
    if tail is None or tail.footer_start != position + MESSAGE_HEADER.size or tail.footer_bytes > length:
        return None
    return EndMessage(position, payload, tail)


def find_end(file: BinaryIO, size: int) -> EndMessage | None:
    """Return the end message to which the tail of a file points; None if there is none."""
    file.seek(max(0, size - TAIL_BYTES))
    tail = Tail.read(file.read(TAIL_BYTES))
    if tail is None or not HEADER_BYTES + MESSAGE_HEADER.size <= tail.footer_start < size:
        return None
    return read_end(file, tail.footer_start - MESSAGE_HEADER.size, size)


def checksum(file: BinaryIO, length: int, start: int = 0) -> int:
    """Return the CRC-32 of the next `length` bytes of a file, which continues the checksum `start`."""
    while length > 0 and (block := file.read(min(length, 1 << 20))):
        start = zlib.crc32(block, start)
        length = length - len(block)
    return start
