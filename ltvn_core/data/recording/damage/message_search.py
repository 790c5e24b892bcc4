"""Finds the messages of a damaged file: by its closing records if any is left, otherwise by patterns of message
headers.

Owns the search. Of a message's content only the name of its store is examined, so a message that was found by a pattern
may be damaged.
"""

import bisect
import itertools
import re
import zlib
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import NamedTuple

from ltvn_core.data.recording.damage.mended_message import with_bit_put_right
from ltvn_core.data.recording.rrf2.closing_record import ClosingRecord, PlacedRecord, find_closing_records
from ltvn_core.data.recording.rrf2.framing import (
    CHUNK_KIND,
    END_KIND,
    FILE_MAGIC,
    HEADER_BYTES,
    KNOWN_KINDS,
    MESSAGE_HEADER,
    TAIL_BYTES,
    MessageSum,
    Tail,
)

_TRIED = 8
"""Largest number of similar headers tried for one message, so that a file with large gaps does not take hours."""
_HEADER_LIKE = re.compile(rb"[\x01-\x03]\x00{7}.{5}\x00{3}\n", re.DOTALL)
"""Pattern of a header: a known kind, a length below a terabyte, and the byte with which the content of our messages
begins."""
_RECORDING_STORE = b"\x08\x01"
"""Beginning of the key of a recording's store; that of the viewer's layout differs."""
_STORE_KIND = 1
_SHORT = 0x7F
"""Largest length that takes one byte."""


class FoundMessage(NamedTuple):
    """A message that can be copied to another file."""

    position: int
    data: bytes
    """Header and content."""
    record: int | None = None
    """Number of the closing record that lists it, whether intact or damaged; None if it was found by its pattern."""
    damaged: bool = False
    """Whether the message differs from its closing record, or is cut off."""

    @property
    def sure(self) -> bool:
        """Whether a checksum confirms that the message is unchanged."""
        return self.record is not None and not self.damaged

    @property
    def end(self) -> int:
        """Position of its end in the file."""
        return self.position + len(self.data)

    @property
    def store(self) -> bytes | None:
        """The store of the message's rows, as Rerun encodes it; None for other messages such as the viewer's layout."""
        kind, _ = MESSAGE_HEADER.unpack_from(self.data)
        payload = self.data[MESSAGE_HEADER.size :]
        if kind != CHUNK_KIND or len(payload) < 2 or payload[0] != 10 or payload[1] > _SHORT:
            return None
        store = payload[2 : 2 + payload[1]]
        # The name may be cut off at the end of the file, and would then look like that of another recording.
        is_whole = len(store) == payload[1]
        return store if is_whole and store.startswith(_RECORDING_STORE) else None


class LostBytes(NamedTuple):
    """An unusable stretch of the file."""

    position: int
    size: int
    record: int | None = None
    """Number of the closing record that lists what is lost; None without one."""


class FoundMessages(NamedTuple):
    """The messages found in a damaged file, in the order of the file."""

    messages: Sequence[FoundMessage]
    lost: Sequence[LostBytes]
    cut: LostBytes | None
    """Last message of a file that was cut off inside it; it is among the messages too. None if there is none."""
    records: Mapping[int, ClosingRecord]
    """Closing records that list messages in this file, by number; several if several files were joined."""
    has_foreign_ending: bool
    """Whether there is a closing record without any of its messages in the file."""


def certain_stores(messages: Iterable[FoundMessage]) -> Sequence[bytes]:
    """Return the recordings in a file, in the order of their first messages.

    Damage may have changed a name that only a single message has, without a checksum or a description of its store.
    """
    messages = list(messages)
    count = Counter(store for message in messages if (store := message.store) is not None)
    described = [each.data for each in messages if MESSAGE_HEADER.unpack_from(each.data)[0] == _STORE_KIND]
    sure = {each.store for each in messages if each.sure}
    return [
        store
        for store, number in count.items()
        if number > 1 or store in sure or any(store in each for each in described)
    ]


def find_messages(data: bytes) -> FoundMessages:
    """Find the messages in a file, in which messages may be damaged, missing, moved or from another file."""
    looks = list(_looking_like_messages(data))
    walked = [part for part in looks if isinstance(part, FoundMessage)]
    placed = find_closing_records(data)
    sure = _written_as_recorded(data, placed, walked)
    known = {number: each.record for number, each in enumerate(placed) if number in _at_home(placed, sure, walked)}
    starts = [HEADER_BYTES, *(each.end + TAIL_BYTES + HEADER_BYTES for each in placed)]
    taken = _Stretches([message for found in sure.values() for message in found.values()])
    # What names another recording is no damaged message of this one.
    foreign = {*certain_stores(walked)} - {message.store for message in taken.messages}
    others = [message for message in walked if message.store in foreign and not taken.overlap(message)]
    taken = _Stretches([*taken.messages, *others])
    damaged = [
        part
        for number, record in known.items()
        for part in _not_as_recorded(data, number, record, sure[number], starts[number], taken)
    ]
    taken = _Stretches([*taken.messages, *(part for part in damaged if isinstance(part, FoundMessage))])
    others = [message for message in walked if not taken.overlap(message)]
    lost = [part for part in damaged if isinstance(part, LostBytes)]
    if not known:
        lost = [part for part in looks if isinstance(part, LostBytes)]
    cut = lost.pop() if not known and lost and lost[-1].position + lost[-1].size == len(data) else None
    if cut is not None and cut.size > MESSAGE_HEADER.size:
        others.append(FoundMessage(cut.position, data[cut.position :], damaged=True))
    return FoundMessages(sorted([*taken.messages, *others]), lost, cut, known, len(known) < len(placed))


_Found = Mapping[int, Mapping[int, FoundMessage]]
"""Number of the closing record -> index of the message in it -> the unchanged message."""


def _written_as_recorded(data: bytes, placed: Sequence[PlacedRecord], walked: Sequence[FoundMessage]) -> _Found:
    """Search every message of the closing records at its original position, and then at positions to which it may have
    moved."""
    by_sum = {_sum(message.data): message.position for message in walked} if placed else {}
    index = _HeaderIndex(data)
    start = HEADER_BYTES
    found: dict[int, dict[int, FoundMessage]] = {}
    for number, each in enumerate(placed):
        found[number] = {}
        position = behind_last = start
        is_whole = _is_end(data, start + each.record.messages_end - HEADER_BYTES)
        for place, written in enumerate(each.record.messages):
            moved = by_sum.get(written)
            # Bytes can be missing or inserted only if the length has changed.
            elsewhere = () if is_whole else index.places(written.header, behind_last)
            for begin in itertools.chain((position,), () if moved is None else (moved,), elsewhere):
                # The header is taken from the record, so that damage to the header alone loses nothing.
                message = written.header + data[begin + MESSAGE_HEADER.size : begin + written.size]
                if zlib.crc32(message) == written.crc32:
                    found[number][place] = FoundMessage(begin, message, number)
                    position = begin
                    behind_last = begin + written.size
                    break
            position += written.size
        start = each.end + TAIL_BYTES + HEADER_BYTES
    return found


def _sum(message: bytes) -> MessageSum:
    kind, length = MESSAGE_HEADER.unpack_from(message)
    return MessageSum(kind, length, zlib.crc32(message))


def _at_home(placed: Sequence[PlacedRecord], sure: _Found, walked: Sequence[FoundMessage]) -> set[int]:
    """Return the numbers of the closing records that have messages in the file; the ending of another file has none."""
    headers = {(message.position, message.data[: MESSAGE_HEADER.size]) for message in walked}
    home = set[int]()
    start = HEADER_BYTES
    for number, each in enumerate(placed):
        sizes = itertools.accumulate((written.size for written in each.record.messages), initial=start)
        alike = sum((at, written.header) in headers for at, written in zip(sizes, each.record.messages, strict=False))
        # The first few messages have the same lengths in any two recordings.
        if sure[number] or 2 * alike > len(each.record.messages):
            home.add(number)
        start = each.end + TAIL_BYTES + HEADER_BYTES
    return home


def _not_as_recorded(
    data: bytes,
    number: int,
    record: ClosingRecord,
    sure: Mapping[int, FoundMessage],
    start: int,
    taken: "_Stretches",
) -> Iterator[FoundMessage | LostBytes]:
    """Yield the messages that were not found unchanged, each from its expected position."""
    position = start
    for place, written in enumerate(record.messages):
        if place in sure:
            position = sure[place].end
            continue
        end = min(position + written.size, taken.next_begin(position), len(data))
        message = written.header + data[position + MESSAGE_HEADER.size : end]
        mended = with_bit_put_right(message, written.crc32) if len(message) == written.size else None
        if mended is not None:
            yield FoundMessage(position, mended, number)
        elif end > position + MESSAGE_HEADER.size:
            yield FoundMessage(position, message, number, damaged=True)
        else:
            yield LostBytes(position, written.size, number)
        position += written.size


class _Stretches:
    """Positions of found messages in a file."""

    def __init__(self, messages: Sequence[FoundMessage]) -> None:
        self.messages = sorted(messages, key=lambda message: message.position)
        self._begins = [message.position for message in self.messages]

    def next_begin(self, position: int) -> int:
        """Return the beginning of the next message at or after `position`; `position` itself if it is inside a
        message."""
        number = bisect.bisect_left(self._begins, position)
        if number and self.messages[number - 1].end > position:
            return position
        return self._begins[number] if number < len(self._begins) else 1 << 62

    def overlap(self, message: FoundMessage) -> bool:
        """Tell whether a message shares bytes with one of these messages."""
        return self.next_begin(message.position) < message.end


class _HeaderIndex:
    """Positions of headers in a file in which bytes may be missing or inserted. Computed at the first use."""

    def __init__(self, data: bytes) -> None:
        self._data = data

    @cached_property
    def _positions(self) -> Mapping[bytes, Sequence[int]]:
        found: dict[bytes, list[int]] = defaultdict(list)
        for match in _HEADER_LIKE.finditer(self._data):
            found[match.group()[: MESSAGE_HEADER.size]].append(match.start())
        return found

    def places(self, header: bytes, begin: int) -> Sequence[int]:
        """Return the first few positions of a header at or after `begin`."""
        positions = self._positions.get(header, ())
        first = bisect.bisect_left(positions, begin)
        return positions[first : first + _TRIED]


def _looking_like_messages(data: bytes) -> Iterator[FoundMessage | LostBytes]:
    """Yield the messages in order; after an interruption, search for the next place at which messages continue."""
    position = HEADER_BYTES
    while position < len(data) and not _is_end(data, position):
        if (behind := _next_file(data, position)) is not None:
            position = behind
            continue
        end = _message_end(data, position)
        if end is not None and _goes_on(data, end):
            yield FoundMessage(position, data[position:end])
            position = end
            continue
        following = _next_message(data, position + 1)
        yield from _between(data, position, end, following)
        position = following


def _between(data: bytes, position: int, end: int | None, following: int) -> Iterator[FoundMessage | LostBytes]:
    """Return a guess of the content between an interruption and the next message."""
    if end is not None and end < following:
        # The length seems right, so the header after it is damaged.
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
    """Return the end of the message at a position; None if there is no message."""
    if not _HEADER_LIKE.match(data, position):
        return None
    _, length = MESSAGE_HEADER.unpack_from(data, position)
    end = position + MESSAGE_HEADER.size + length
    return end if end <= len(data) else None


def _goes_on(data: bytes, position: int) -> bool:
    """Tell whether a message, the end message or the cut end of the file is at a position."""
    return (
        position == len(data)
        or _is_end(data, position)
        or bool(_HEADER_LIKE.match(data, position))
        or _next_file(data, position) is not None
    )


def _next_file(data: bytes, position: int) -> int | None:
    """Return the beginning of the messages of another file, if an ending and a file header are at a position."""
    if position + MESSAGE_HEADER.size > len(data):
        return None
    kind, length = MESSAGE_HEADER.unpack_from(data, position)
    end = position + MESSAGE_HEADER.size + length + TAIL_BYTES
    if kind != END_KIND or Tail.read(data[end - TAIL_BYTES : end]) is None or data[end : end + 4] != FILE_MAGIC:
        return None
    return end + HEADER_BYTES


def _is_end(data: bytes, position: int) -> bool:
    if position + MESSAGE_HEADER.size + TAIL_BYTES > len(data):
        return False
    kind, length = MESSAGE_HEADER.unpack_from(data, position)
    return kind == END_KIND and position + MESSAGE_HEADER.size + length + TAIL_BYTES == len(data)


def _next_message(data: bytes, position: int) -> int:
    """Return the next position of a message that is followed by another message, or the end of the messages."""
    for found in _HEADER_LIKE.finditer(data, position):
        end = _message_end(data, found.start())
        if end is not None and _goes_on(data, end):
            return found.start()
    return _end_of_messages(data, position)


def _end_of_messages(data: bytes, position: int) -> int:
    """Return the position of the end message, or the place where the file was cut off."""
    tail = Tail.read(data[-TAIL_BYTES:])
    if tail is None:
        return len(data)
    end = tail.footer_start - MESSAGE_HEADER.size
    return end if position <= end <= len(data) else len(data)
