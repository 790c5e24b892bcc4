"""Opens what is left of a damaged recording, message by message.

Owns which messages are left out, and the temporary file of the others. Without a closing record each message is first
read in a process of its own, since a damaged one can end the process that reads it.
"""

import tempfile
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import pyarrow as pa
import rerun as rr

from ltvn_core.errors import RecordingError
from ltvn_core.protobuf_fields import bytes_field, read_fields
from ltvn_core.recording import schema
from ltvn_core.recording.closing_record import ClosingRecord
from ltvn_core.recording.message_search import FoundMessages, find_messages
from ltvn_core.recording.metadata import RecordingMetadata, package_versions, read_schema_version
from ltvn_core.recording.reader import Recording
from ltvn_core.recording.reading_trial import reading_failure, unreadable_messages
from ltvn_core.recording.rrd_contents import (
    DESCRIPTION,
    RrdContents,
    StoreRows,
    has_expected_columns,
    read_description,
    read_store,
    several_recordings,
    unreadable,
)
from ltvn_core.recording.rrd_framing import CHUNK_KIND, MESSAGE_HEADER, TAIL_BYTES, Tail
from ltvn_core.robots.robot_spec import LOCOBOT

_FILE_HEADER = b"RRF2" + bytes([*map(int, rr.__version__.split("+")[0].split(".")[:2]), 0, 0]) + b"\x01\x02\x00\x00"
"""As this Rerun writes it: magic, version, LZ4, protobuf."""
_STORE_KIND = 1
_ROW_ID = b"\n\x12\t" + bytes(8) + b"\x11" + bytes(8)
_STORE_SOURCE = b"*\x0c\x08\x02\x12\x08\n\x06\x08\x03\x10\x0b\x18\x07"
"""Python 3.11; Rerun asks for some source and we for none."""
_EVENTS = f"/{schema.EVENTS}"
_RECORDING_STORE = b"\x08\x01"


class Salvage(NamedTuple):
    """What is left of a damaged recording."""

    recording: Recording
    record: ClosingRecord | None
    """What the file said of itself when it was finished, where that is still to be read."""
    described: bool
    """The description could be read; else another stands in for it."""
    lost_bytes: int
    """Of messages that are left out, or were cut."""
    lost_places: Sequence[tuple[int, int]]
    """Where those before the cut begin and how long they are, in bytes."""
    ended: bool
    """The file was finished once."""


def open_salvage(path: Path, recording_id: str | None = None) -> Salvage:
    """Open what is whole of a damaged or unfinished recording.

    Raises RecordingError when nothing is, and when the file holds several recordings and `recording_id` names none.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise unreadable(path, error) from error
    found = find_messages(data)
    chunks = [each for each in found.messages if _store(each.data) is not None]
    stores = _stores([each.data for each in found.messages])
    if not stores:
        raise RecordingError(f"{path} holds no whole message of a recording; nothing in it can be saved.")
    store = _chosen_store(path, stores, recording_id)
    chunks = [each for each in chunks if _store(each.data) not in {*stores} - {store}]
    messages = [each.data for each in chunks]
    bad, rows = _read_apart(path, store, messages, trusted=found.record is not None)
    contents = _contents(path, rows, found.record)
    lost = [(chunks[place].position, len(chunks[place].data)) for place in bad]
    lost += [(each.position, each.size) for each in found.lost]
    return Salvage(
        recording=Recording(path, contents.contents),
        record=found.record,
        described=contents.described,
        lost_bytes=sum(size for _, size in lost) + (0 if found.cut is None else found.cut.size),
        lost_places=sorted(lost),
        ended=_ended(data, found),
    )


def _read_apart(
    path: Path, store: bytes, messages: Sequence[bytes], *, trusted: bool
) -> tuple[Mapping[int, str], StoreRows]:
    """Read messages from a temporary file of their own; return those that cannot be read, and the rows of the others.

    Messages that are trusted are as they were written, so that nothing has to be tried.
    """
    try:
        with tempfile.TemporaryDirectory(prefix="ltvn-") as folder:
            kept = Path(folder) / "kept.rrd"
            _write(kept, store, messages)
            doubtful = not trusted and reading_failure(kept) is not None
            bad = unreadable_messages(kept, len(messages)) if doubtful else {}
            if bad:
                _write(kept, store, [message for place, message in enumerate(messages) if place not in bad])
            return bad, read_store(kept, part_of=path)
    except OSError as error:
        raise RecordingError(
            f"{path} cannot be copied to the temporary folder {tempfile.gettempdir()} ({error.strerror}); make room "
            "there, or name another in the variable TMPDIR."
        ) from error


def _ended(data: bytes, found: FoundMessages) -> bool:
    return found.record is not None or Tail.read(data[-TAIL_BYTES:]) is not None


class _Described(NamedTuple):
    contents: RrdContents
    described: bool


def _contents(path: Path, store: StoreRows, record: ClosingRecord | None) -> _Described:
    rows = {entity: [batch for batch in batches if _is_usable(entity, batch)] for entity, batches in store.rows.items()}
    for place in range(len(rows.get(DESCRIPTION, ())), 0, -1):
        # The last copy first; a recording has two of them.
        try:
            described = store._replace(rows={DESCRIPTION: rows[DESCRIPTION][:place]})
            meta = read_description(path, described)
        except RecordingError:
            if _has_other_schema(rows[DESCRIPTION][place - 1]):
                raise
            continue
        return _Described(RrdContents(meta, rows, record), described=True)
    return _Described(RrdContents(_stand_in(store.recording_id), rows, record), described=False)


def _is_usable(entity: str, batch: pa.RecordBatch) -> bool:
    if not has_expected_columns(entity, batch):
        return False
    # Of an event each column has one value.
    single = [name for name in schema.COLUMNS[schema.EVENTS] if name != schema.STEP] if entity == _EVENTS else []
    return all(len(batch.column(name).flatten()) == batch.num_rows for name in single)


def _has_other_schema(row: pa.RecordBatch) -> bool:
    try:
        return read_schema_version(row) != schema.SCHEMA_VERSION
    except (LookupError, ValueError, TypeError):
        return False


def _stand_in(recording_id: str) -> RecordingMetadata:
    """Return a description for a recording whose own one is lost."""
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


def _write(path: Path, store: bytes, messages: Sequence[bytes]) -> None:
    info = _ROW_ID + bytes_field(2, bytes_field(2, store) + _STORE_SOURCE)
    described = MESSAGE_HEADER.pack(_STORE_KIND, len(info)) + info
    with path.open("wb") as file:
        file.write(_FILE_HEADER + described)
        file.writelines(messages)


def _store(message: bytes) -> bytes | None:
    """Return to which store a message's rows belong, as Rerun writes it; None for the viewer's layout and the like."""
    kind, _ = MESSAGE_HEADER.unpack_from(message)
    payload = message[MESSAGE_HEADER.size :]
    if kind != CHUNK_KIND or len(payload) < 2 or payload[0] != 10 or payload[1] > 127:
        return None
    store = payload[2 : 2 + payload[1]]
    return store if store.startswith(_RECORDING_STORE) else None


def _stores(messages: Sequence[bytes]) -> Sequence[bytes]:
    """Return the recordings in a file, the one with most messages first.

    Where damage may have changed the name of one in a message, only those count that the file describes.
    """
    stores = Counter(store for message in messages if (store := _store(message)) is not None)
    described = [message for message in messages if MESSAGE_HEADER.unpack_from(message)[0] == _STORE_KIND]
    ordered = [store for store, _ in stores.most_common()]
    return [store for store in ordered if any(store in each for each in described)] or ordered[:1]


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
