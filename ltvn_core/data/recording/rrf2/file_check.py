"""Checks the bytes of a file against its closing record, before anything in it is read.

Reads the file message by message, in plain Python. Does not interpret messages.
"""

import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np

from ltvn_core.data.recording.rrf2.chunk_table import listed_chunks
from ltvn_core.data.recording.rrf2.closing_record import ClosingRecord, EndMessage, chunk_places, read_closing_record
from ltvn_core.data.recording.rrf2.layout import (
    END_KIND,
    HEADER_BYTES,
    KNOWN_KINDS,
    MESSAGE_HEADER,
    MESSAGE_SUM,
    TAIL_BYTES,
    MessageSums,
    Tail,
    sizes_of,
)
from ltvn_core.data.recording.rrf2.row_index import RowIndex, read_index


class FileCheck(NamedTuple):
    """Result of checking the bytes of a file, without interpreting them."""

    whole_bytes: int
    """Length of the header and the complete messages, in bytes."""
    finished: bool
    """Whether the end message follows them, and is followed by the tail and the end of the file."""
    damage: str | None = None
    """What changed since the file was finished, as a clause; None for an unfinished file, and if its checksums are
    correct."""
    messages: MessageSums = np.empty(0, MESSAGE_SUM)
    """The messages before the end message; none for an unfinished file."""
    record: ClosingRecord | None = None
    """Closing record; None for an unfinished file, a damaged end, and a file that Rerun itself finished."""
    row_index: RowIndex | None = None
    """Index of its rows, if it has one."""


def check_file(path: Path) -> FileCheck:
    """Read a file and compare every byte with its closing record, if it has one. Raises OSError."""
    with path.open("rb") as file:
        size = file.seek(0, 2)
        file.seek(max(0, size - TAIL_BYTES))
        tail = Tail.read(file.read(TAIL_BYTES))
        if tail is not None and (found := _check_at_once(file, tail, size)) is not None:
            return found
        file.seek(0)
        header_crc32 = zlib.crc32(file.read(HEADER_BYTES))
        messages = np.array([*walk_messages(file, size)], MESSAGE_SUM)
        whole_bytes = min(size, HEADER_BYTES) + int(sizes_of(messages).sum())
        end = _read_end(file, whole_bytes, size)
    if end is None:
        damage = None if tail is None else f"no valid message follows byte {whole_bytes} of {size}"
        return FileCheck(whole_bytes, finished=False, damage=damage)
    record = read_closing_record(end)
    damage = _damage(header_crc32, messages, end, record)
    return FileCheck(whole_bytes, finished=True, damage=damage, messages=messages, record=record)


def _check_at_once(file: BinaryIO, tail: Tail, size: int) -> FileCheck | None:
    """Check the bytes of an undamaged file with an index by a single checksum; None for any other file."""
    position = tail.footer_start - MESSAGE_HEADER.size
    end = _read_end(file, position, size) if HEADER_BYTES <= position < size else None
    record = None if end is None else read_closing_record(end)
    index = None if end is None or record is None else read_index(end.appended, position)
    if record is None or index is None or record.messages_end != position:
        return None
    file.seek(0)
    if _checksum(file, position) != index.body_crc32:
        return None
    return FileCheck(position, finished=True, messages=record.messages, record=record, row_index=index)


def _damage(header_crc32: int, messages: MessageSums, end: EndMessage, record: ClosingRecord | None) -> str | None:
    if record is None:
        return _damage_without_record(messages, end)
    if header_crc32 != record.header_crc32:
        return "its first 12 bytes changed"
    both = min(len(messages), len(record.messages))
    for place in np.flatnonzero(messages[:both] != record.messages[:both])[:1].tolist():
        position = HEADER_BYTES + int(sizes_of(messages[:place]).sum())
        return f"message {place}, at byte {position}, changed"
    if len(messages) != len(record.messages):
        return f"it has {len(messages)} messages, but {len(record.messages)} when it was finished"
    return None


def _damage_without_record(messages: MessageSums, end: EndMessage) -> str | None:
    """Check a file that Rerun itself finished, through an older recorder or one of Rerun's tools; return its damage.

    Both write a table of all chunks. A missing table means that an empty ending was appended to a truncated file.
    """
    if end.appended:
        return "its table of checksums changed"
    if not end.footer_is_right:
        return "Rerun's table of its chunks changed"
    if not end.footer:
        return (
            "it has neither our table of checksums nor Rerun's table of its chunks, as if it had been cut off and "
            "then finished"
        )
    listed = listed_chunks(end.footer)
    if listed is not None and listed != set(chunk_places(messages)):
        return "Rerun's table does not list the same chunks as the file"
    return None


def walk_messages(file: BinaryIO, size: int) -> Iterator[tuple[int, int, int]]:
    """Yield the messages of a file of `size` bytes, each as `MESSAGE_SUM`, up to the first place that is not one.

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
        yield kind, _checksum(file, length, zlib.crc32(header)), length


def _read_end(file: BinaryIO, position: int, size: int) -> EndMessage | None:
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


def _checksum(file: BinaryIO, length: int, start: int = 0) -> int:
    """Return the CRC-32 of the next `length` bytes of a file, which continues the checksum `start`."""
    while length > 0 and (block := file.read(min(length, 1 << 20))):
        start = zlib.crc32(block, start)
        length = length - len(block)
    return start
