"""Judges the bytes of a recording before Rerun's reader sees one of them.

Owns the comparison of a file with its closing record. Does not look into messages.
"""

import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from ltvn_core.recording import rrd_framing
from ltvn_core.recording.chunk_table import listed_chunks
from ltvn_core.recording.closing_record import ClosingRecord, chunk_places, read_closing_record
from ltvn_core.recording.rrd_framing import EndMessage, MessageSum, RrdFraming


class FileCheck(NamedTuple):
    """What the bytes of a file say, without what they mean."""

    framing: RrdFraming
    record: ClosingRecord | None
    """None for an unfinished file, a damaged end, and a file that Rerun itself finished."""
    damage: str | None
    """What is wrong in a finished file, as a clause; None when nothing is, as far as its checksums go."""


def check_file(path: Path) -> FileCheck:
    """Walk over a file and compare every byte with its closing record, where it has one. Raises OSError."""
    with path.open("rb") as file:
        size = file.seek(0, 2)
        file.seek(0)
        header_crc32 = zlib.crc32(file.read(rrd_framing.HEADER_BYTES))
        messages = tuple(rrd_framing.walk_messages(file, size))
        whole_bytes = min(size, rrd_framing.HEADER_BYTES) + sum(message.size for message in messages)
        end = rrd_framing.read_end(file, whole_bytes, size)
    framing = RrdFraming(len(messages), whole_bytes, finished=end is not None)
    if end is None:
        return FileCheck(framing, None, None)
    record = read_closing_record(end)
    return FileCheck(framing, record, _damage(header_crc32, messages, end, record))


def _damage(
    header_crc32: int, messages: Sequence[MessageSum], end: EndMessage, record: ClosingRecord | None
) -> str | None:
    if record is None:
        return _damage_without_record(messages, end)
    if header_crc32 != record.header_crc32:
        return "its first 12 bytes changed"
    position = rrd_framing.HEADER_BYTES
    for place, (found, written) in enumerate(zip(messages, record.messages, strict=False)):
        if found != written:
            return f"message {place}, at byte {position}, changed"
        position += found.size
    if len(messages) != len(record.messages):
        return f"it holds {len(messages)} messages and was finished with {len(record.messages)}"
    return None


def _damage_without_record(messages: Sequence[MessageSum], end: EndMessage) -> str | None:
    """Judge a file that was finished by Rerun itself: by an older recorder, or by a tool of Rerun's.

    Either writes a table of all chunks. Whoever puts an empty ending behind a file that was cut does not.
    """
    if end.appended:
        return "its table of checksums changed"
    if not end.footer_is_right:
        return "Rerun's table of its chunks changed"
    if not end.footer:
        return "it has neither our table of checksums nor Rerun's table of its chunks, as if it was cut and then ended"
    listed = listed_chunks(end.footer)
    if listed is not None and listed != set(chunk_places(messages)):
        return "Rerun's table lists other chunks than it holds"
    return None
