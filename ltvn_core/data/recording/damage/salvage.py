"""Opens the remains of a damaged recording, message by message and row by row.

Owns the decision which messages are trusted, and the temporary files from which they are read. Messages without a valid
checksum are first read in a separate process, because a damaged message can crash Rerun's reader.
"""

import tempfile
from collections import Counter
from collections.abc import Iterable, Sequence, Set
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import pyarrow as pa
import rerun as rr

from ltvn_core.data.recording import schema
from ltvn_core.data.recording.damage.mended_message import readable_again
from ltvn_core.data.recording.damage.message_search import FoundMessage, FoundMessages, certain_stores, find_messages
from ltvn_core.data.recording.metadata import RecordingMetadata, package_versions, read_schema_version
from ltvn_core.data.recording.reader import Recording
from ltvn_core.data.recording.reading_trial import reading_failure, unreadable_messages
from ltvn_core.data.recording.rrd_contents import (
    DESCRIPTION,
    RrdContents,
    StoreRows,
    read_description,
    read_store,
    require_steps,
    several_recordings,
    unreadable,
)
from ltvn_core.data.recording.rrf2.closing_record import ClosingRecord
from ltvn_core.data.recording.rrf2.framing import CHUNK_KIND, MESSAGE_HEADER, TAIL_BYTES, Tail
from ltvn_core.errors import RecordingError
from ltvn_core.protobuf_fields import bytes_field, read_fields
from ltvn_core.robots.robot_spec import LOCOBOT

_FILE_HEADER = b"RRF2" + bytes([*map(int, rr.__version__.split("+")[0].split(".")[:2]), 0, 0]) + b"\x01\x02\x00\x00"
"""File header of the installed Rerun: magic, version, LZ4, protobuf."""
_STORE_KIND = 1
_ROW_ID = b"\n\x12\t" + bytes(8) + b"\x11" + bytes(8)
_STORE_SOURCE = b"*\x0c\x08\x02\x12\x08\n\x06\x08\x03\x10\x0b\x18\x07"
"""Source in a store's description: Python 3.11. Rerun requires some source, but this program does not use it."""
_EVENTS = f"/{schema.EVENTS}"


class Salvage(NamedTuple):
    """The remains of a damaged recording."""

    recording: Recording
    record: ClosingRecord | None
    """Closing record; None if it is not readable."""
    described: bool
    """Whether the description is readable; otherwise a default replaces it."""
    lost_bytes: int
    """Number of bytes in messages that are damaged, missing or cut off; some of their rows may be saved."""
    lost_places: Sequence[tuple[int, int]]
    """Position and length in bytes of the lost parts before the cut."""
    ended: bool
    """Whether the file was finished."""


def open_salvage(path: Path, recording_id: str | None = None) -> Salvage:
    """Open the intact parts of a damaged or unfinished recording.

    Raises RecordingError if there are none, or if the file holds several recordings and `recording_id` selects none.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise unreadable(path, error) from error
    found = find_messages(data)
    stores = certain_stores(found.messages) or [each.store for each in found.messages if each.store is not None][:1]
    if not stores:
        raise RecordingError(f"{path} has no undamaged message of a recording; nothing can be recovered.")
    store = _chosen_store(path, stores, recording_id)
    number = _record_of(found, store)
    messages = [each for each in found.messages if _belongs(each, store, {*stores} - {store}, number)]
    # If there is a closing record, messages that it does not list are not trusted.
    trusted = [each for each in messages if each.sure or (number is None and not each.damaged)]
    doubtful = [each for each in messages if not each.sure and (number is not None or each.damaged)]
    bad, rows = _read_apart(path, store, trusted, doubtful)
    record = None if number is None else found.records[number]
    contents = _contents(path, rows, record)
    lost = [(each.position, len(each.data)) for each in bad]
    lost += [(each.position, len(each.data)) for each in found.messages if each.damaged and each.record == number]
    nameless = [each for each in found.messages if not each.damaged and each.store not in (None, *stores)]
    lost += [(each.position, len(each.data)) for each in nameless]
    if found.cut is not None:
        lost = [place for place in lost if place[0] != found.cut.position]
    lost += [(each.position, each.size) for each in found.lost if each.record == number]
    return Salvage(
        recording=Recording(path, contents.contents),
        record=record,
        described=contents.described,
        lost_bytes=sum(size for _, size in lost) + (0 if found.cut is None else found.cut.size),
        lost_places=sorted(lost),
        ended=record is not None or (_has_table(data) and not found.records and not found.has_foreign_ending),
    )


def _record_of(found: FoundMessages, store: bytes) -> int | None:
    """Return the number of the closing record that lists a store's messages; None if there is none."""
    speaking = Counter(each.record for each in found.messages if each.sure and each.store == store)
    if speaking:
        return speaking.most_common(1)[0][0]
    # All messages of the recording may be damaged.
    return (
        next(iter(found.records), None)
        if len(found.records) == 1 and not any(each.sure for each in found.messages)
        else None
    )


def _belongs(message: FoundMessage, store: bytes, others: Set[bytes], number: int | None) -> bool:
    """Tell whether a message may hold rows of a store: it names the store, or damage may have changed the name."""
    if MESSAGE_HEADER.unpack_from(message.data)[0] != CHUNK_KIND:
        return False
    if not message.damaged or number is None:
        return message.store == store or (message.damaged and message.record is None and message.store is None)
    return message.record == number and message.store not in others


def _read_apart(
    path: Path, store: bytes, trusted: Sequence[FoundMessage], doubtful: Sequence[FoundMessage]
) -> tuple[Sequence[FoundMessage], StoreRows]:
    """Read messages from separate temporary files; return the trusted messages that cannot be read, and the rows.

    Unchanged messages need no trial. From doubtful messages, and from those that cannot be read, only rows that match
    their own checksum are used.
    """
    try:
        with tempfile.TemporaryDirectory(prefix="ltvn-") as folder:
            kept = Path(folder) / "kept.rrd"
            _write(kept, store, (each.data for each in trusted))
            tried = not all(each.sure for each in trusted) and reading_failure(kept) is not None
            places = unreadable_messages(kept, len(trusted)) if tried else {}
            bad = [trusted[place] for place in sorted(places)]
            if bad:
                _write(kept, store, (each.data for place, each in enumerate(trusted) if place not in places))
            rest = _readable_parts(Path(folder), store, [*doubtful, *bad])
            return bad, read_store(kept, part_of=path, doubtful=rest)
    except OSError as error:
        raise RecordingError(
            f"{path} cannot be copied to the temporary folder {tempfile.gettempdir()} ({error.strerror}); make room "
            "there, or name another in the variable TMPDIR."
        ) from error


def _readable_parts(folder: Path, store: bytes, doubtful: Sequence[FoundMessage]) -> Sequence[Path]:
    """Write the remains of doubtful messages to new files that Rerun can read.

    The first holds their most likely content, the second the alternatives.
    """
    if not doubtful:
        return ()
    likely = folder / "likely.rrd"
    others = folder / "others.rrd"
    for path, part in ((likely, slice(0, 1)), (others, slice(1, None))):
        guesses = [
            each for message in doubtful for each in islice(readable_again(message.data, store), part.start, part.stop)
        ]
        _write(path, store, guesses)
        bad = unreadable_messages(path, len(guesses))
        _write(path, store, (each for place, each in enumerate(guesses) if place not in bad))
    return likely, others


def _has_table(data: bytes) -> bool:
    """Tell whether a file ends with a table of its chunks, like every file that Rerun has finished."""
    tail = Tail.read(data[-TAIL_BYTES:])
    return tail is not None and tail.footer_bytes > 0


class _Described(NamedTuple):
    contents: RrdContents
    described: bool


def _contents(path: Path, store: StoreRows, record: ClosingRecord | None) -> _Described:
    # Damage may have taken the steps of a few rows, a tool of Rerun those of all.
    require_steps(path, {entity for entity in store.without_steps if not _has_steps(store.rows[entity])})
    rows = {entity: [batch for batch in batches if _is_usable(entity, batch)] for entity, batches in store.rows.items()}
    for place in range(len(rows.get(DESCRIPTION, ())), 0, -1):
        # The last copy is used; a recording has two of them.
        try:
            described = store._replace(rows={DESCRIPTION: rows[DESCRIPTION][:place]})
            meta = read_description(path, described)
        except RecordingError:
            if _has_other_schema(rows[DESCRIPTION][place - 1]):
                raise
            continue
        return _Described(RrdContents(meta, rows, record), described=True)
    return _Described(RrdContents(_stand_in(store.recording_id), rows, record), described=False)


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


def _write(path: Path, store: bytes, messages: Iterable[bytes]) -> None:
    info = _ROW_ID + bytes_field(2, bytes_field(2, store) + _STORE_SOURCE)
    described = MESSAGE_HEADER.pack(_STORE_KIND, len(info)) + info
    with path.open("wb") as file:
        file.write(_FILE_HEADER + described)
        file.writelines(messages)


def _chosen_store(path: Path, stores: Sequence[bytes], recording_id: str | None) -> bytes:
    ids = {_recording_id(store): store for store in stores}
    if recording_id in ids:
        return ids[recording_id]
    if recording_id is not None:
        raise RecordingError(f"{path} holds no recording {recording_id!r}, but {' and '.join(ids)}.")
    if len(stores) > 1:
        raise several_recordings(path, list(ids))
    return stores[0]


def _recording_id(store: bytes) -> str:
    try:
        return next(field.value.decode() for field in read_fields(store) if isinstance(field.value, bytes))
    except (ValueError, StopIteration):
        return "?"
