"""Closing record of a finished recording, and the end message in which it is.

The closing record holds a checksum of every message, and the number of written rows. It is a field of the end
message that Rerun skips. Its checksums cover every byte of the file, including the record itself, the rest of the end
message, and the tail. Owns its layout. Does not interpret messages.
"""

import json
import logging
import struct
import zlib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import pyarrow as pa

from ltvn_core.data.recording.rrf2.chunk_table import ChunkPlace, ChunkTable
from ltvn_core.data.recording.rrf2.layout import (
    CHUNK_KIND,
    END_KIND,
    HEADER_BYTES,
    MESSAGE_HEADER,
    MESSAGE_SUM,
    MessageSums,
    Tail,
    sizes_of,
)
from ltvn_core.data.recording.rrf2.row_index import FrameList, index_field
from ltvn_core.protobuf_fields import bytes_field_start
from ltvn_core.structured_text import parse_json

_LOG = logging.getLogger(__name__)
_MAGIC = b"LTVNEND1"
_FIELD = 7000
"""Number of the protobuf field; Rerun has no such field and skips it."""
_SIZES = struct.Struct("<II")
"""Length of the JSON text and number of messages."""
_CRC = struct.Struct("<I")
_LONGEST = 2**40
"""Length in bytes above which no message is true."""


@dataclass(frozen=True, slots=True, eq=False)
class ClosingRecord:
    """The checksums and counts of a finished recording."""

    header_crc32: int
    """Checksum of the 12 bytes at the beginning of the file."""
    messages: MessageSums
    """Checksums of all messages before the end message, in order."""
    rows: Mapping[str, int]
    """Number of rows that were written with a time, by entity path; shows rows that Rerun lost."""
    static_rows: Mapping[str, int] = field(default_factory=dict)
    """Number of rows that were written without a time, by entity path."""

    @property
    def messages_end(self) -> int:
        """Position of the end message in bytes."""
        return HEADER_BYTES + int(sizes_of(self.messages).sum())


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


class RecordingEnding:
    """Builds the ending of a recording that is written in blocks: first the file's header of 12 bytes, then the
    messages."""

    def __init__(self, recording_id: str) -> None:
        """Begin with nothing."""
        self._recording_id = recording_id
        self.rows = Counter[str]()
        """Number of rows with a time by entity path; the logger counts them."""
        self.static_rows = Counter[str]()
        """Number of rows without a time by entity path."""
        self.chunks = ChunkTable()
        """Rerun's table of the chunks; whoever takes chunks from Rerun adds them."""
        self.frames = FrameList()
        """The frames; whoever logs a frame appends it."""
        self._header_crc32: int | None = None
        self._body_crc32 = 0
        self._table = bytearray()
        """Checksums as `MESSAGE_SUM`."""

    def count(self, block: bytes) -> None:
        """Register the header, or a message that was written to the file."""
        self._body_crc32 = zlib.crc32(block, self._body_crc32)
        if self._header_crc32 is None:
            self._header_crc32 = self._body_crc32
            return
        self.chunks.take_in()
        kind, length = MESSAGE_HEADER.unpack_from(block)
        self._table += np.array((kind, zlib.crc32(block), length), MESSAGE_SUM).tobytes()

    def encoded(self, *, complete: bool, is_short: bool = False) -> bytes:
        """Return the bytes to write after the last message.

        Unless `complete`, the record contains no numbers of rows, and there is no index. A short ending omits Rerun's
        table of chunks, and the index.
        """
        record = ClosingRecord(
            header_crc32=self._header_crc32 or 0,
            messages=np.frombuffer(self._table, MESSAGE_SUM),
            rows=self.rows if complete else {},
            static_rows=self.static_rows if complete else {},
        )
        if is_short:
            return closing_bytes(record)
        places = chunk_places(record.messages)
        index = self._index(record.messages, len(places)) if complete else b""
        return closing_bytes(record, self.chunks.encoded(places), index)

    def _index(self, messages: MessageSums, chunks: int) -> bytes:
        """Return the index; empty if it cannot be made. Never raises, because a recording is whole without it."""
        try:
            listed = self.chunks.listed(chunks)
            if listed is None:
                return b""
            return index_field(self._recording_id, self._body_crc32, listed, messages, self.frames.table())
        except (pa.ArrowException, ValueError, LookupError, TypeError, MemoryError):
            _LOG.warning("The recording has no index: it could not be made.", exc_info=True)
            return b""


def closing_bytes(record: ClosingRecord, footer: bytes = b"", index: bytes = b"") -> bytes:
    """Return the bytes after the last message: the end message with Rerun's footer, the index and the record, and the
    tail."""
    counts = {"rows": dict(record.rows), "static_rows": dict(record.static_rows)}
    text = json.dumps(counts, sort_keys=True, separators=(",", ":")).encode()
    sizes = _SIZES.pack(len(text), len(record.messages))
    body = _MAGIC + sizes + text + record.messages.tobytes() + _CRC.pack(record.header_crc32)
    before = footer + index + bytes_field_start(_FIELD, len(body) + 2 * _CRC.size)
    start = record.messages_end + MESSAGE_HEADER.size
    tail = Tail.of(start, footer)
    # The first checksum covers the surroundings of the record, the second one the record with the first checksum.
    # So the record can be trusted even if its surroundings are damaged.
    end = EndMessage(record.messages_end, before + body + bytes(2 * _CRC.size), tail)
    body += _CRC.pack(_surroundings_crc32(end, len(body) + 2 * _CRC.size))
    body += _CRC.pack(zlib.crc32(body))
    return end._replace(payload=before + body).encoded()


def read_closing_record(end: EndMessage) -> ClosingRecord | None:
    """Return the record in an end message; None if there is none, or if any byte of the message or the tail has
    changed."""
    at = end.payload.find(_MAGIC, len(end.footer))
    record = None if at < 0 else _parsed(end.payload[at:])
    stored = end.payload[-2 * _CRC.size : -_CRC.size]
    whole = record is not None and stored == _CRC.pack(_surroundings_crc32(end, len(end.payload) - at))
    return record if whole else None


def last_closing_record(data: bytes) -> ClosingRecord | None:
    """Return the last record in a damaged file, if it is unchanged itself."""
    at = data.rfind(_MAGIC)
    return None if at < 0 else _parsed(data[at : at + _size(data[at : at + len(_MAGIC) + _SIZES.size])])


def _size(data: bytes) -> int:
    """Return the length of the record at the beginning of `data`, according to its own fields."""
    if len(data) < len(_MAGIC) + _SIZES.size:
        return 0
    text_bytes, count = _SIZES.unpack_from(data, len(_MAGIC))
    return len(_MAGIC) + _SIZES.size + text_bytes + count * MESSAGE_SUM.itemsize + 3 * _CRC.size


def _parsed(data: bytes) -> ClosingRecord | None:
    """Return the record that consists of all bytes of `data`; None if it has changed."""
    if not data or len(data) != _size(data) or _CRC.pack(zlib.crc32(data[: -_CRC.size])) != data[-_CRC.size :]:
        return None
    text_at = len(_MAGIC) + _SIZES.size
    text_bytes, count = _SIZES.unpack_from(data, len(_MAGIC))
    messages = np.frombuffer(data, MESSAGE_SUM, count, text_at + text_bytes)
    if (messages["length"] > _LONGEST).any():
        return None
    try:
        counts = parse_json(data[text_at : text_at + text_bytes])
        rows, static_rows = (_counts(counts[name]) for name in ("rows", "static_rows"))
    except (ValueError, LookupError, TypeError, AttributeError):
        return None  # Its checksum is correct, so it was written like this.
    return ClosingRecord(
        header_crc32=_CRC.unpack_from(data, text_at + text_bytes + messages.nbytes)[0],
        messages=messages,
        rows=rows,
        static_rows=static_rows,
    )


def _counts(counts: Mapping[str, object]) -> Mapping[str, int]:
    """Return the numbers of rows by entity. Raises ValueError if one is no number."""
    numbers = {entity: count for entity, count in counts.items() if type(count) is int and count >= 0}
    if len(numbers) < len(counts):
        raise ValueError("a number of rows that is none")
    return numbers


def _surroundings_crc32(end: EndMessage, record_bytes: int) -> int:
    """Return the checksum of the end message without the record, and of the tail."""
    before = MESSAGE_HEADER.pack(END_KIND, len(end.payload)) + end.payload[:-record_bytes]
    return zlib.crc32(end.tail.encoded(), zlib.crc32(before))


def chunk_places(messages: MessageSums) -> Sequence[ChunkPlace]:
    """Return the positions of the chunks' payloads in a file with these messages."""
    lengths = messages["length"].astype(np.int64)
    begins = HEADER_BYTES + np.cumsum(sizes_of(messages)) - lengths
    are_chunks = messages["kind"] == CHUNK_KIND
    return [*map(ChunkPlace, begins[are_chunks].tolist(), lengths[are_chunks].tolist())]
