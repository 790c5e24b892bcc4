"""Opens what is left of a damaged or unfinished recording, message by message.

A message that cannot be read costs its rows; reading goes on where the next message begins. A message that differs from
the closing record gives only the rows that agree with a checksum of their own.
"""

import re
import zlib
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import pyarrow as pa

from ltvn_core.data.recording import schema
from ltvn_core.data.recording.mapped_batches import MappedBatches
from ltvn_core.data.recording.metadata import RecordingMetadata, package_versions, read_schema_version
from ltvn_core.data.recording.reader import Recording
from ltvn_core.data.recording.rrd_contents import (
    DESCRIPTION,
    RrdContents,
    StoreRows,
    joined_store,
    read_description,
    require_steps,
    the_recording,
    unreadable,
)
from ltvn_core.data.recording.rrf2.closing_record import ClosingRecord, last_closing_record
from ltvn_core.data.recording.rrf2.layout import (
    CHUNK_KIND,
    END_KIND,
    FILE_MAGIC,
    HEADER_BYTES,
    MESSAGE_HEADER,
    TAIL_BYTES,
    UNREADABLE,
    ChunkMessage,
    Tail,
    read_chunk,
)
from ltvn_core.data.recording.stored_rows import believable, damaged_first
from ltvn_core.errors import RecordingError
from ltvn_core.protobuf_fields import read_fields
from ltvn_core.robots.robot_spec import LOCOBOT

_HEADER_LIKE = re.compile(rb"[\x01-\x03]\x00{7}.{5}\x00{3}\n", re.DOTALL)
"""Pattern of a header: a known kind, a length below a terabyte, and the byte with which content begins."""
_EVENTS = f"/{schema.EVENTS}"


class Salvage(NamedTuple):
    """The remains of a damaged recording."""

    recording: Recording
    record: ClosingRecord | None
    """Closing record; None if it is not readable."""
    described: bool
    """Whether the description is readable; otherwise a default replaces it."""
    lost_bytes: int
    """Number of bytes in messages that are damaged or cut off; some of their rows may be saved."""
    lost_places: Sequence[tuple[int, int]]
    """Position and length in bytes of the lost parts before the cut."""
    ended: bool
    """Whether the file was finished."""


@dataclass(slots=True)
class _Store:
    """What was read of one store."""

    rows: MappedBatches = field(default_factory=MappedBatches)
    places: list[tuple[int, int]] = field(default_factory=list)
    """Position and length of its messages."""
    is_recorded: bool = False
    """Whether the closing record lists any of its messages."""


def open_salvage(path: Path, recording_id: str | None = None) -> Salvage:
    """Open the intact parts of a damaged or unfinished recording.

    Raises RecordingError if there are none, or if the file holds several recordings and `recording_id` selects none.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise unreadable(path, error) from error
    record = last_closing_record(data)
    stores: dict[bytes, _Store] = defaultdict(_Store)
    lost = _read_messages(data, record, stores)
    # A single message may have got its name by damage.
    sure = {key: store for key, store in stores.items() if len(store.places) > 1} or dict(stores)
    lost += [place for key, store in stores.items() if key not in sure for place in store.places]
    chosen, store = the_recording(path, sure, recording_id)
    found = {entity: damaged_first(entity, each) for entity, each in store.rows.take().items()}
    rows = joined_store(path, StoreRows(chosen, found))
    rows = rows._replace(rows={entity: damaged_first(entity, each) for entity, each in rows.rows.items()})
    contents, described = _contents(path, rows, record if store.is_recorded else None)
    ended = store.is_recorded or (record is None and _has_table(data))
    record = record if store.is_recorded else None
    cut = {(begin, size) for begin, size in lost if begin + size == len(data) and not ended}
    return Salvage(
        recording=Recording(path, contents),
        record=record,
        described=described,
        lost_bytes=sum(size for _, size in lost),
        lost_places=sorted({*lost} - cut),
        ended=ended,
    )


def _read_messages(data: bytes, record: ClosingRecord | None, stores: dict[bytes, _Store]) -> list[tuple[int, int]]:
    """Add the rows of all readable messages to their stores; return position and length of what is damaged."""
    known = None if record is None else set(record.messages.tolist())
    lost = list[tuple[int, int]]()
    for begin, end, chunk in _messages(data):
        is_sure = known is None or _sum(data[begin:end]) in known
        if chunk is not None:
            store = stores[chunk.store]
            store.places.append((begin, end - begin))
            store.is_recorded |= known is not None and is_sure
            for rows in [chunk.batch] if is_sure else believable(chunk.entity, [chunk.batch]):
                store.rows.append(chunk.entity, rows)
        if chunk is None or not is_sure:
            start = lost.pop()[0] if lost and sum(lost[-1]) == begin else begin
            lost.append((start, end - start))
    return lost


def _messages(data: bytes) -> Iterator[tuple[int, int, ChunkMessage | None]]:
    """Yield begin and end of each message with rows, and what it holds; None for bytes that are no message.

    Messages without rows are left out if they are whole.
    """
    place = HEADER_BYTES
    while place < len(data):
        kind, end = _extent(data, place)
        if kind == END_KIND and Tail.read(data[end : end + TAIL_BYTES]) is not None:
            place = end + TAIL_BYTES
            place += HEADER_BYTES if data.startswith(FILE_MAGIC, place) else 0
            continue
        payload = data[place + MESSAGE_HEADER.size : end] if _fits(data, place) else b""
        try:
            chunk = read_chunk(payload)
        except UNREADABLE:
            chunk = None
        if chunk is None and not (kind != CHUNK_KIND and _fits(data, place) and _is_protobuf(payload)):
            if not (_fits(data, place) and (_fits(data, end) or _extent(data, end)[0] == END_KIND)):
                found = (each.start() for each in _HEADER_LIKE.finditer(data, place + 1))
                end = next((each for each in found if _fits(data, each)), len(data))
            yield place, end, None
        elif chunk is not None:
            yield place, end, chunk
        place = end


def _extent(data: bytes, place: int) -> tuple[int, int]:
    """Return the kind of the message at a place, and its end; kind -1 if no header has room there."""
    if place + MESSAGE_HEADER.size > len(data):
        return -1, len(data)
    kind, length = MESSAGE_HEADER.unpack_from(data, place)
    return kind, place + MESSAGE_HEADER.size + length


def _fits(data: bytes, place: int) -> bool:
    """Tell whether a whole message may begin at a place."""
    return _HEADER_LIKE.match(data, place) is not None and _extent(data, place)[1] <= len(data)


def _is_protobuf(payload: bytes) -> bool:
    try:
        return bool(list(read_fields(payload)))
    except ValueError:
        return False


def _sum(message: bytes) -> tuple[int, int, int]:
    kind, length = MESSAGE_HEADER.unpack_from(message) if len(message) >= MESSAGE_HEADER.size else (0, 0)
    return kind, zlib.crc32(message), length


def _has_table(data: bytes) -> bool:
    """Tell whether a file ends with a table of its chunks, like every file that Rerun has finished."""
    tail = Tail.read(data[-TAIL_BYTES:])
    return tail is not None and tail.footer_bytes > 0


def _contents(path: Path, store: StoreRows, record: ClosingRecord | None) -> tuple[RrdContents, bool]:
    """Return the usable rows, and whether their description is among them."""
    # Damage may have taken the steps of a few rows, a tool of Rerun those of all.
    require_steps(path, {entity for entity in store.without_steps if not _has_steps(store.rows[entity])})
    rows = {entity: [batch for batch in batches if _is_usable(entity, batch)] for entity, batches in store.rows.items()}
    for place in range(len(rows.get(DESCRIPTION, ())), 0, -1):
        # The last copy is used; a recording has two of them.
        try:
            meta = read_description(path, store._replace(rows={DESCRIPTION: rows[DESCRIPTION][:place]}))
        except RecordingError:
            if _has_other_schema(rows[DESCRIPTION][place - 1]):
                raise
            continue
        return RrdContents(meta, rows, record), True
    return RrdContents(_stand_in(store.recording_id), rows, record), False


def _has_steps(batches: Sequence[pa.RecordBatch]) -> bool:
    return any(schema.STEP in batch.schema.names for batch in batches)


def _is_usable(entity: str, batch: pa.RecordBatch) -> bool:
    if not schema.has_expected_columns(entity, batch) or (entity == _EVENTS and not _has_steps([batch])):
        return False
    # Each column of an event has one value.
    single = [name for name in schema.COLUMNS[schema.EVENTS] if name != schema.STEP] if entity == _EVENTS else []
    return all(len(batch.column(name).flatten()) == batch.num_rows for name in single)


def _has_other_schema(row: pa.RecordBatch) -> bool:
    try:
        return read_schema_version(row) != schema.SCHEMA_VERSION
    except (LookupError, ValueError, TypeError):
        return False


def _stand_in(recording_id: str) -> RecordingMetadata:
    """Return a default description for a recording whose own description is lost."""
    return RecordingMetadata(
        scene="unknown",
        config={},
        fingerprint="",
        camera=LOCOBOT.camera,
        schema=schema.SCHEMA_VERSION,
        versions=package_versions(),
        started_at="",
        recording_id=recording_id,
    )
