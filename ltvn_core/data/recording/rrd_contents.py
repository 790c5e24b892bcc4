"""Opens a `.rrd` file as a recording of this program, and returns its rows by entity.

Owns the checks that the file is a finished recording of this application and schema, with a clear error otherwise.
Rerun's tools may split the columns of a row into several chunks; such rows are joined again by their row ids, because
several events may have the same step, or where `rerun rrd split` gave each column of a copied row an id of its own, by
the place on the timeline. Independent of frames and events.
"""

from collections import defaultdict
from collections.abc import Hashable, Iterator, Mapping, Sequence, Set
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ltvn_core.atomic_files import require_usable_name
from ltvn_core.data.recording import schema
from ltvn_core.data.recording.indexed_rows import FileMessages, indexed_batches
from ltvn_core.data.recording.mapped_batches import MappedBatches
from ltvn_core.data.recording.metadata import RecordingMetadata, read_metadata, read_schema_version
from ltvn_core.data.recording.rrf2.closing_record import ClosingRecord
from ltvn_core.data.recording.rrf2.file_check import FileCheck, check_file
from ltvn_core.data.recording.rrf2.layout import FILE_MAGIC, RECORDING_STORE, UNREADABLE, recording_id
from ltvn_core.data.recording.rrf2.row_index import RowIndex
from ltvn_core.errors import RecordingError

_Store = TypeVar("_Store")
ROW_ID = "rerun.controls.RowId"
DESCRIPTION = f"/__properties/{schema.PROPERTIES}"


def joined_rows(batches: Sequence[pa.RecordBatch], needed: Set[str], key: str = ROW_ID) -> Sequence[pa.RecordBatch]:
    """Return batches in which every row has all of its columns and occurs once; rows with the same `key` are one.

    Rows without a needed column are left out. Batches that need no joining stay unchanged.
    """
    if not all(key in batch.schema.names for batch in batches):
        return batches if key == ROW_ID else ()
    ids = [batch.column(key).to_pylist() for batch in batches]
    every = list(dict.fromkeys(row_id for part in ids for row_id in part))
    if len(every) == sum(map(len, ids)) and all(_is_whole(batch, needed) for batch in batches):
        return batches
    fields = {field.name: field for batch in batches for field in batch.schema}
    columns = {key: pa.array(every, fields[key].type)}
    for name in fields.keys() - {key}:
        columns[name] = _column(name, batches, ids, every)
    if not needed <= columns.keys():
        return ()
    joined = pa.RecordBatch.from_arrays(list(columns.values()), names=list(columns))
    lacking = {row for name in needed for row, cell in enumerate(columns[name].is_valid().to_pylist()) if not cell}
    return [joined.take(pa.array([row for row in range(len(every)) if row not in lacking], pa.int64()))]


def _is_whole(batch: pa.RecordBatch, needed: Set[str]) -> bool:
    return needed <= set(batch.schema.names) and not any(batch.column(name).null_count for name in needed)


def _column(
    name: str, batches: Sequence[pa.RecordBatch], ids: Sequence[Sequence[Hashable]], every: Sequence[Hashable]
) -> pa.Array:
    """Return a column for the rows `every`; empty if no batch has the column."""
    pieces = list[pa.Array]()
    places = dict[Hashable, int]()
    start = 0
    for batch, row_ids in zip(batches, ids, strict=True):
        if name not in batch.schema.names:
            continue
        pieces.append(batch.column(name))
        filled = pieces[-1].is_valid().to_pylist()
        places |= {row_id: start + row for row, row_id in enumerate(row_ids) if filled[row]}
        start += batch.num_rows
    return pa.concat_arrays(pieces).take(pa.array([places.get(row_id) for row_id in every], pa.int64()))


class StoreRows(NamedTuple):
    """The rows of the recording in a file, still in Arrow format; images are compressed."""

    recording_id: str
    rows: Mapping[str, Sequence[pa.RecordBatch]]
    """Batches by entity path (with a leading slash) in the order of the file, each row with all of its columns."""
    without_steps: Set[str] = frozenset()
    """Entities that have exact columns, but not the timeline that orders them."""


class RrdContents(NamedTuple):
    """The rows of a recording."""

    meta: RecordingMetadata
    rows: Mapping[str, Sequence[pa.RecordBatch]]
    """Batches by entity path (with a leading slash), in the order of the file; with an index, each is read when it is
    asked for."""
    record: ClosingRecord | None = None
    """The closing record; None for older files and those that Rerun's tools rewrote."""
    row_index: RowIndex | None = None
    """Index of the rows; None for older files, and if all rows were read."""

    def batches_of(self, entity: str) -> Sequence[pa.RecordBatch]:
        """Return the batches of one entity."""
        return self.rows.get(f"/{entity}", ())

    def row_count(self, entity: str) -> int:
        """Return the number of rows of one entity that have a time."""
        if self.row_index is not None and entity in schema.COLUMNS:
            chunks = self.row_index.chunks.get(f"/{entity}")
            return 0 if chunks is None else int(chunks.rows.sum())
        return sum(batch.num_rows for batch in self.batches_of(entity) if schema.STEP in batch.schema.names)

    def user_rows(self) -> Iterator[pa.RecordBatch]:
        """Yield the rows that a user logged in addition to the recorder's."""
        for entity, batches in self.rows.items():
            if schema.is_of_user(entity):
                yield from batches


def require_rrd(path: Path) -> None:
    """Raise RecordingError if `path` is not a Rerun file."""
    require_file(path)
    try:
        with path.open("rb") as file:
            genuine = file.read(len(FILE_MAGIC)) == FILE_MAGIC
    except OSError as error:
        raise unreadable(path, error) from error
    if not genuine:
        size = path.stat().st_size
        what = "is empty" if size == 0 else f"is not a Rerun recording ({size} bytes of another format)"
        raise RecordingError(f"{path} {what}; name a .rrd file written by ltvn.")


def require_file(path: Path) -> None:
    """Raise RecordingError if `path` is not a file."""
    require_usable_name(path)
    if not path.exists():
        raise RecordingError(f"There is no file {path}; `ltvn collect` and `ltvn demo` make recordings.")
    if not path.is_file():
        raise RecordingError(f"{path} is not a file; name a single .rrd recording.")


def unreadable(path: Path, error: OSError) -> RecordingError:
    """Return the error for a file that the system cannot read."""
    return RecordingError(f"{path} cannot be read ({error.strerror}); check its permissions, and the disk.")


def require_whole(path: Path) -> FileCheck:
    """Check the bytes of a finished file. Raises RecordingError that names `ltvn repair` if any is wrong."""
    require_rrd(path)
    try:
        found = check_file(path)
    except OSError as error:
        raise unreadable(path, error) from error
    if found.finished and found.damage is None:
        return found
    if found.damage is not None:
        what = f"was damaged since it was written: {found.damage}"
    else:
        size = path.stat().st_size
        what = f"is cut off or was never finished: {found.whole_bytes} of its {size} bytes are undamaged"
    raise RecordingError(f"{path} {what}. Run `ltvn repair {path} --output NEW.rrd` to recover all undamaged frames.")


def open_contents(path: Path, *, whole: bool = False) -> RrdContents:
    """Open a complete and finished recording; reads all of its rows if it has no index, or if `whole`.

    Raises RecordingError for anything else, with advice on what to do.
    """
    found = require_whole(path)
    try:
        messages = FileMessages(path, found.messages)
    except OSError as error:
        raise unreadable(path, error) from error
    if (index := found.row_index) is not None and not whole:
        rows = indexed_batches(messages, index)
        return RrdContents(read_description(path, StoreRows(index.recording_id, rows)), rows, found.record, index)
    store = joined_store(path, _read_rows(messages))
    # First, because a newer schema may have other columns.
    meta = read_description(path, store)
    for entity, batches in store.rows.items():
        for batch in batches:
            if not schema.has_expected_columns(entity, batch):
                raise _damaged_inside(path, f"a column of {entity} is missing or has another type")
    require_steps(path, store.without_steps)
    return RrdContents(meta, store.rows, found.record)


def require_steps(path: Path, without_steps: Set[str]) -> None:
    """Raise RecordingError if an entity lacks the timeline of steps."""
    for entity in sorted(without_steps):
        raise RecordingError(
            f"{path} lacks the timeline `{schema.STEP}` of {entity}, which gives the step of each row. Use the "
            "original recording, which has it."
        )


def the_recording(path: Path, stores: Mapping[bytes, _Store], wanted: str | None = None) -> tuple[str, _Store]:
    """Return id and store of this program's only recording in a file, or of the `wanted` one. Raises RecordingError."""
    found = {key: store for key, store in stores.items() if key.startswith(RECORDING_STORE)}
    program = schema.APPLICATION_ID.encode()  # The key ends with its length and itself.
    ours = {recording_id(key): found[key] for key in found if key.endswith(bytes([len(program)]) + program)}
    if not found:
        raise RecordingError(
            f"{path} has no undamaged message of a recording: it is empty, damaged or only a layout of the viewer, and "
            "nothing can be recovered. Name a .rrd file written by ltvn."
        )
    if not ours:
        raise RecordingError(f"{path} was written by another program; name a file written by ltvn.")
    if wanted is not None and wanted not in ours:
        raise RecordingError(f"{path} holds no recording {wanted!r}, but {' and '.join(ours)}.")
    if wanted is None and len(ours) > 1:  # As `rerun rrd merge` writes it.
        raise RecordingError(
            f"{path} holds {len(ours)} recordings: {' and '.join(ours)}. Extract one with `ltvn repair {path} "
            f"--recording-id {next(iter(ours))} --output NEW.rrd`, and open that."
        )
    chosen = wanted or next(iter(ours))
    return chosen, ours[chosen]


def joined_store(path: Path, store: StoreRows) -> StoreRows:
    """Return the rows of a recording, each with all of its columns. Raises RecordingError if they do not match."""
    try:
        joined = {entity: _joined(entity, each) for entity, each in store.rows.items()}
    except (pa.ArrowException, TypeError) as error:
        raise _damaged_inside(path, f"its columns do not match ({error})") from error
    without_steps = {
        entity for entity, each in store.rows.items() if any(_has_no_step(entity, batch) for batch in each)
    }
    return store._replace(rows=joined, without_steps=without_steps)


def _read_rows(messages: FileMessages) -> StoreRows:
    """Read all rows of the only recording in a file. Raises RecordingError."""
    path = messages.path
    stores: dict[bytes, MappedBatches] = defaultdict(MappedBatches)
    try:
        described = messages.stores()
        for chunk in messages.chunks():
            if chunk.store not in described:
                raise ValueError(f"rows of {chunk.entity} belong to no recording")
            stores[chunk.store].append(chunk.entity, chunk.batch)
    except UNREADABLE as error:
        lacks = isinstance(error, LookupError | UnicodeError)
        why = "a message lacks a part, or a name in it is no text" if lacks else str(error).rstrip(".")
        raise _damaged_inside(path, why) from error
    name, rows = the_recording(path, stores)
    return StoreRows(name, rows.take())


def _joined(entity: str, batches: Sequence[pa.RecordBatch]) -> Sequence[pa.RecordBatch]:
    """Join rows whose columns are in several batches; rows without a time stay unchanged, except for the description
    and the scene."""
    name = entity.removeprefix("/")
    needed = schema.COLUMNS.get(name)
    if needed is None:
        return _last_values(batches) if entity in (DESCRIPTION, f"/{schema.SCENE}") else batches
    timed = [batch for batch in batches if schema.STEP in batch.schema.names]
    untimed = [batch for batch in batches if schema.STEP not in batch.schema.names]
    held = {column for batch in timed for column in batch.schema.names}
    whole = joined_rows(timed, needed.keys() | (held & {schema.DEPTH_PICTURE}))
    if whole is timed:
        return batches
    key = schema.EVENT if name == schema.EVENTS else schema.STEP
    places = _places(whole, key)
    rest = [part for batch in timed if key in held and (part := _without(batch, key, places)).num_rows]
    return [*untimed, *whole, *joined_rows(rest, needed.keys(), key)]


def _places(batches: Sequence[pa.RecordBatch], key: str) -> NDArray[np.int64]:
    columns = [batch.column(key).to_numpy(zero_copy_only=False) for batch in batches if key in batch.schema.names]
    return np.concatenate([np.empty(0, np.int64), *columns])


def _without(batch: pa.RecordBatch, key: str, places: NDArray[np.int64]) -> pa.RecordBatch:
    """Return the rows that are not at any of these places; none of a batch without the timeline."""
    if key not in batch.schema.names:
        return batch.slice(0, 0)
    return batch.filter(pa.array(~np.isin(batch.column(key).to_numpy(zero_copy_only=False), places)))


def _last_values(batches: Sequence[pa.RecordBatch]) -> Sequence[pa.RecordBatch]:
    """Return batches unchanged if one has all columns; otherwise a row with the last value of each column."""
    columns = dict[str, pa.Array]()
    for batch in batches:
        columns |= {name: part for name in batch.schema.names if len(part := batch.column(name).drop_null()[-1:])}
    if any(columns.keys() <= {*batch.schema.names} for batch in batches):
        return batches
    return [pa.RecordBatch.from_arrays(list(columns.values()), names=list(columns))]


def _has_no_step(entity: str, batch: pa.RecordBatch) -> bool:
    names = set(batch.schema.names)
    return schema.STEP not in names and bool(names & schema.COLUMNS.get(entity.removeprefix("/"), {}).keys())


def read_description(path: Path, store: StoreRows) -> RecordingMetadata:
    """Read the metadata of a recording. Raises RecordingError if there are none, or if their schema differs."""
    try:
        row = store.rows[DESCRIPTION][-1]
        version = read_schema_version(row)
    except (IndexError, KeyError, ValueError, TypeError) as error:
        raise RecordingError(
            f"{path} has no description of its content; name a .rrd file written by `ltvn`."
        ) from error
    if version != schema.SCHEMA_VERSION:
        raise RecordingError(
            f"{path} has schema {version}, this program reads schema {schema.SCHEMA_VERSION}; use the version of ltvn "
            "that wrote it."
        )
    try:
        return read_metadata(row, store.recording_id)
    except (LookupError, ValueError, TypeError) as error:
        raise _damaged_inside(path, f"its description cannot be read ({error})") from error


def _damaged_inside(path: Path, why: str) -> RecordingError:
    return RecordingError(
        f"{path} is damaged: {why}. Run `ltvn repair {path} --output NEW.rrd` to recover the undamaged part."
    )
