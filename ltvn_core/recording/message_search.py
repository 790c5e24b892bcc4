"""Finds the whole messages of a damaged file: by its closing record where that is left, else by their looks.

Owns the search. Does not look into messages beyond their first byte, so without a closing record some of what it finds
is damaged.
"""

import bisect
import itertools
import re
import zlib
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from typing import NamedTuple

from ltvn_core.recording import rrd_framing
from ltvn_core.recording.closing_record import ClosingRecord, find_closing_record
from ltvn_core.recording.rrd_framing import CHUNK_KIND, END_KIND, HEADER_BYTES, KNOWN_KINDS, MESSAGE_HEADER, TAIL_BYTES

_TRIED = 8
"""So many places of like headers are looked at for one message, so that a file with large holes takes no hours."""
_HEADER_LIKE = re.compile(rb"[\x01-\x03]\x00{7}.{5}\x00{3}\n", re.DOTALL)
"""A known kind, a length below a terabyte, and the first byte that the payload of any of our messages begins with."""


class FoundMessage(NamedTuple):
    """A message that can be put into another file."""

    position: int
    data: bytes
    """Header and payload."""


class LostBytes(NamedTuple):
    """A stretch of the file of which nothing can be used."""

    position: int
    size: int


class FoundMessages(NamedTuple):
    """What a damaged file still holds, in the order of the file."""

    messages: Sequence[FoundMessage]
    lost: Sequence[LostBytes]
    cut: LostBytes | None
    """The last message of a file that ends in the middle of it."""
    record: ClosingRecord | None
    """Where there is one, all messages are as they were written; else they only look like messages."""


def find_messages(data: bytes) -> FoundMessages:
    """Find the messages of a whole file's bytes, of which any may be damaged, missing or moved."""
    record = find_closing_record(data)
    parts = list(_looking_like_messages(data)) if record is None else list(_as_recorded(data, record))
    lost = [part for part in parts if isinstance(part, LostBytes)]
    cut = lost.pop() if record is None and lost and lost[-1].position + lost[-1].size == len(data) else None
    return FoundMessages([part for part in parts if isinstance(part, FoundMessage)], lost, cut, record)


def _as_recorded(data: bytes, record: ClosingRecord) -> Iterator[FoundMessage | LostBytes]:
    """Look for every message where it was written, and else where it may have moved to."""
    # Only where the length differs bytes can be missing or put in.
    index = _HeaderIndex(b"" if _is_end(data, record.messages_end) else data)
    position = behind_last = HEADER_BYTES
    for written in record.messages:
        found = None
        for place in itertools.chain((position,), index.places(written.header, behind_last)):
            # The header from the record, so that damage to this alone costs nothing.
            message = written.header + data[place + MESSAGE_HEADER.size : place + written.size]
            if zlib.crc32(message) == written.crc32:
                found, position = FoundMessage(place, message), place
                behind_last = place + written.size
                break
        yield LostBytes(position, written.size) if found is None else found
        position += written.size


class _HeaderIndex:
    """Where in a file which header stands, since bytes may be missing or put in. Made when it is first asked for."""

    def __init__(self, data: bytes) -> None:
        self._data = data

    @cached_property
    def _positions(self) -> Mapping[bytes, Sequence[int]]:
        found: dict[bytes, list[int]] = defaultdict(list)
        for match in _HEADER_LIKE.finditer(self._data):
            found[match.group()[: MESSAGE_HEADER.size]].append(match.start())
        return found

    def places(self, header: bytes, begin: int) -> Sequence[int]:
        """Return the first few places of a header from `begin` on."""
        positions = self._positions.get(header, ())
        first = bisect.bisect_left(positions, begin)
        return positions[first : first + _TRIED]


def _looking_like_messages(data: bytes) -> Iterator[FoundMessage | LostBytes]:
    """Walk over the messages, and where the walk cannot go on, look for the next place from which it can."""
    position = HEADER_BYTES
    while position < len(data) and not _is_end(data, position):
        end = _message_end(data, position)
        if end is not None and _goes_on(data, end):
            yield FoundMessage(position, data[position:end])
            position = end
            continue
        following = _next_message(data, position + 1)
        yield from _between(data, position, end, following)
        position = following


def _between(data: bytes, position: int, end: int | None, following: int) -> Iterator[FoundMessage | LostBytes]:
    """Guess what stands between a place where the walk stopped and the next one from which it goes on."""
    if end is not None and end < following:
        # Its length seems right, so the header behind it is wrong.
        yield FoundMessage(position, data[position:end])
        position = end
    kind = int.from_bytes(data[position : position + 8], "little")
    payload = data[position + MESSAGE_HEADER.size : following]
    if payload.startswith(b"\n") and following < len(data):
        header = MESSAGE_HEADER.pack(kind if kind in KNOWN_KINDS else CHUNK_KIND, len(payload))
        yield FoundMessage(position, header + payload)
    elif following > position:
        yield LostBytes(position, following - position)


def _message_end(data: bytes, position: int) -> int | None:
    """Return where the message at a place ends, None where there is none."""
    if not _HEADER_LIKE.match(data, position):
        return None
    _, length = MESSAGE_HEADER.unpack_from(data, position)
    end = position + MESSAGE_HEADER.size + length
    return end if end <= len(data) else None


def _goes_on(data: bytes, position: int) -> bool:
    """Tell whether a message, the end message or the cut end of the file stands at a place."""
    return position == len(data) or _is_end(data, position) or bool(_HEADER_LIKE.match(data, position))


def _is_end(data: bytes, position: int) -> bool:
    if position + MESSAGE_HEADER.size + TAIL_BYTES > len(data):
        return False
    kind, length = MESSAGE_HEADER.unpack_from(data, position)
    return kind == END_KIND and position + MESSAGE_HEADER.size + length + TAIL_BYTES == len(data)


def _next_message(data: bytes, position: int) -> int:
    """Return the next place at which a message stands that another one follows, or where the messages end."""
    for found in _HEADER_LIKE.finditer(data, position):
        end = _message_end(data, found.start())
        if end is not None and _goes_on(data, end):
            return found.start()
    return _end_of_messages(data, position)


def _end_of_messages(data: bytes, position: int) -> int:
    """Return where the end message begins, or where the file is cut."""
    tail = rrd_framing.Tail.read(data[-TAIL_BYTES:])
    if tail is None:
        return len(data)
    end = tail.footer_start - MESSAGE_HEADER.size
    return end if position <= end <= len(data) else len(data)
