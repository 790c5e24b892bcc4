"""Rerun's table of chunks (the manifests in its footer), which is assembled at the end of a recording.

Rerun computes a table for every block of messages that it returns. Their rows are kept here, some fifty bytes each,
until the file ends. Owns the layout of the footer. The columns of Rerun's rows are copied without being interpreted,
except for the position of a chunk in the file.
"""

import logging
from array import array
from collections import defaultdict, deque
from collections.abc import Iterator, Mapping, Sequence, Set
from typing import NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ltvn_core.data.recording import schema
from ltvn_core.data.recording.rrf2.arrow_tables import read_table, unpacked_lz4
from ltvn_core.data.recording.rrf2.sorbet_schema import SorbetSchema, as_rerun_merges
from ltvn_core.protobuf_fields import bytes_field, bytes_fields, number_field, read_fields

_LOG = logging.getLogger(__name__)
MOST_CELLS = 24_000_000
"""Largest number of cells (rows times columns) of a table, which needs some fifteen bytes per cell while it is
assembled.

A larger recording gets no table. The limit is about an hour of driving: 65,000 chunks and 354 columns take about 3 s on
one core and 370 MB.
"""
_MANIFESTS = 1
_STORE, _SCHEMA, _SCHEMA_SHA256, _ROWS = 1, 2, 3, 4
_SCHEMA_BYTES = 1
_ENCODING, _PAYLOAD, _COMPRESSION, _SIZE = 1, 2, 3, 4
_LZ4 = 2
_ENTITY, _CHUNK_ID, _OFFSET, _LENGTH = "chunk_entity_path", "chunk_id", "chunk_byte_offset", "chunk_byte_size"
_TEXTS = (_ENTITY, _CHUNK_ID)
_LISTED = ("chunk_num_rows", f"{schema.STEP}:start", f"{schema.STEP}:end", "chunk_is_static")
_RECORDING = b"\x08\x01"
"""Beginning of the key of a recording's store; that of the viewer's layout differs."""


class ChunkPlace(NamedTuple):
    """Position and length of the payload of a message with a chunk, in bytes."""

    offset: int
    length: int


class ListedChunk(NamedTuple):
    """A chunk of one entity, as Rerun's table describes it."""

    number: int
    """Number of the chunk among all chunks of the file."""
    rows: int
    first_step: int
    """Smallest step of its rows; 0 for rows without a time."""
    last_step: int
    is_static: bool
    """Whether its rows have no time."""


class _Block(NamedTuple):
    footer: bytes
    offsets: Sequence[int]
    """Offsets in bytes of the payloads of chunks in the block, in order."""


class _Layout(NamedTuple):
    """Properties that all rows of the same kind share."""

    entity: str
    columns: tuple[str, ...]
    """Columns that are neither empty nor zero."""
    places: tuple[int, ...]
    """Index, for each column, of its value among the distinct values of a row; most columns repeat the values of
    others."""


class _Rows:
    """The rows of one layout, in compact form."""

    def __init__(self) -> None:
        self.chunks = array("I")
        """Index of the chunk that each row describes."""
        self.numbers = array("q")
        """The distinct values of each row, one row after the other."""


class _Store:
    """The rows of one store: the recording, or the viewer's layout."""

    def __init__(self) -> None:
        self.fields: dict[str, pa.Field] = {}
        """The columns of the table by name, in an order of their own."""
        self.rows: dict[_Layout, _Rows] = defaultdict(_Rows)
        self.schemas: dict[bytes, SorbetSchema] = {}
        """Rerun's schemas of the store's columns, by checksum."""


class ChunkTable:
    """Collects the tables of blocks, and encodes the table of the file. One thread may call `add` while another calls
    `take_in`."""

    def __init__(self) -> None:
        """Begin with nothing."""
        self._waiting: deque[_Block] = deque()
        self._stores: dict[bytes, _Store] = defaultdict(_Store)
        self._chunk_ids = bytearray()
        self._count = 0
        self._incomplete = False

    def add(self, footer: bytes, offsets: Sequence[int]) -> None:
        """Queue the footer of a block, with the offsets of its chunks' payloads in the block. Fast, because nothing is
        decoded yet."""
        self._waiting.append(_Block(footer, offsets))

    def take_in(self) -> None:
        """Decode the queued footers, in some milliseconds per block. Never raises: at worst the file gets no table."""
        while self._waiting and not self._incomplete:
            block = self._waiting.popleft()
            try:
                self._read(block)
            except (pa.ArrowException, ValueError, LookupError, TypeError, MemoryError):
                _LOG.warning(
                    "The recording will have no table of chunks: the layout of Rerun's own table is unknown.",
                    exc_info=True,
                )
                self._incomplete = True

    def encoded(self, places: Sequence[ChunkPlace]) -> bytes:
        """Return Rerun's footer for a file with the chunks that were added first, which are at `places`.

        Empty if any of these chunks was in no table, or if there are too many. Never raises, like `take_in`.
        """
        self.take_in()
        stores = {key: store for key, store in self._stores.items() if store.rows}
        cells = sum(len(store.fields) * len(places) for store in stores.values())
        if self._incomplete or not places or len(places) > self._count or cells > MOST_CELLS:
            return b""
        try:
            return b"".join(bytes_field(_MANIFESTS, self._manifest(key, stores[key], places)) for key in stores)
        except (pa.ArrowException, ValueError, LookupError, TypeError, RuntimeError, MemoryError):
            _LOG.warning("The recording has no table of chunks: it could not be made.", exc_info=True)
            return b""

    def listed(self, count: int) -> Mapping[str, Sequence[ListedChunk]] | None:
        """Return those of the first `count` chunks that are read back, by entity; None if any chunk was in no table."""
        self.take_in()
        if self._incomplete or count > self._count:
            return None
        found: dict[str, list[ListedChunk]] = defaultdict(list)
        for key, store in self._stores.items():
            if not key.startswith(_RECORDING):
                continue
            for layout, rows in store.rows.items():
                if schema.is_read_back(layout.entity):
                    found[layout.entity] += _listed(layout, rows, count)
        return {entity: sorted(chunks) for entity, chunks in found.items()}

    def _read(self, block: _Block) -> None:
        chunk_of = {offset: self._count + place for place, offset in enumerate(block.offsets)}
        ids = dict[int, bytes]()
        for number, manifest in read_fields(block.footer):
            if number == _MANIFESTS and isinstance(manifest, bytes):
                ids |= self._read_manifest(manifest, chunk_of)
        if len(ids) != len(chunk_of):
            raise ValueError(f"{len(chunk_of) - len(ids)} chunks are not in the table")
        self._chunk_ids += b"".join(ids[chunk] for chunk in sorted(ids))
        self._count += len(ids)

    def _read_manifest(self, manifest: bytes, chunk_of: Mapping[int, int]) -> dict[int, bytes]:
        """Store the rows of a table; return the ids of its chunks, by the chunk's number."""
        parts = bytes_fields(manifest)
        store = self._stores[parts[_STORE]]
        sha256 = parts[_SCHEMA_SHA256]
        if sha256 not in store.schemas:
            store.schemas[sha256] = SorbetSchema(bytes_fields(parts[_SCHEMA])[_SCHEMA_BYTES], sha256)
        batch = _read_batch(parts[_ROWS])
        chunks = [chunk_of[offset] for offset in batch.column(_OFFSET).to_pylist()]
        if not store.fields.keys() >= set(batch.schema.names):
            store.fields |= {field.name: field for field in batch.schema if field.name not in store.fields}
        names = [name for name in batch.schema.names if name not in (*_TEXTS, _OFFSET, _LENGTH)]
        cells = [_cells(batch.column(name)) for name in names]
        numbers = np.stack([each.numbers for each in cells], axis=1)
        filled = np.stack([each.filled for each in cells], axis=1)
        for row, (chunk, entity) in enumerate(zip(chunks, batch.column(_ENTITY).to_pylist(), strict=True)):
            columns = np.flatnonzero(filled[row])
            distinct, places = np.unique(numbers[row, columns], return_inverse=True)
            layout = _Layout(entity, tuple(names[column] for column in columns), tuple(places.tolist()))
            rows = store.rows[layout]
            rows.chunks.append(chunk)
            rows.numbers.extend(distinct.tolist())
        return dict(zip(chunks, batch.column(_CHUNK_ID).to_pylist(), strict=True))

    def _manifest(self, key: bytes, store: _Store, places: Sequence[ChunkPlace]) -> bytes:
        schema = as_rerun_merges(list(store.schemas.values()))
        stream = _stream_bytes(self._batch(store, places))
        compressed = pa.Codec("lz4_raw").compress(stream, asbytes=True)
        rows = (
            number_field(_ENCODING, 1)
            + bytes_field(_PAYLOAD, compressed)
            + number_field(_COMPRESSION, _LZ4)
            + number_field(_SIZE, len(stream))
        )
        return b"".join(
            (
                bytes_field(_STORE, key),
                bytes_field(_SCHEMA, bytes_field(_SCHEMA_BYTES, schema.encoded)),
                bytes_field(_SCHEMA_SHA256, schema.sha256),
                bytes_field(_ROWS, rows),
            )
        )

    def _batch(self, store: _Store, places: Sequence[ChunkPlace]) -> pa.RecordBatch:
        """Return the table of a store, with rows in the order of the file."""
        chunks = np.sort(np.concatenate([np.frombuffer(rows.chunks, np.uint32) for rows in store.rows.values()]))
        chunks = chunks[chunks < len(places)]
        placed = np.array(places, np.uint64).reshape(-1, 2)[chunks]
        ids = np.frombuffer(self._chunk_ids, "V16")[chunks]
        known: dict[str, pa.Array] = {
            _CHUNK_ID: pa.FixedSizeBinaryArray.from_buffers(pa.binary(16), len(ids), [None, pa.py_buffer(ids)]),
            _OFFSET: pa.array(placed[:, 0].copy()),
            _LENGTH: pa.array(placed[:, 1].copy()),
            _ENTITY: _entities(store, chunks),
        }
        parts = _column_parts(store, chunks)
        fields = list(store.fields.values())
        arrays = [known[each.name] if each.name in known else _column(each, parts, len(chunks)) for each in fields]
        return pa.RecordBatch.from_arrays(arrays, schema=pa.schema(fields))


def _listed(layout: _Layout, rows: _Rows, count: int) -> Iterator[ListedChunk]:
    numbers = np.frombuffer(rows.numbers, np.int64).reshape(len(rows.chunks), -1)
    place_of = dict(zip(layout.columns, layout.places, strict=True))
    absent = np.zeros(len(numbers), np.int64)
    columns = [numbers[:, place_of[name]] if name in place_of else absent for name in _LISTED]
    for chunk, *cells in zip(rows.chunks, *(column.tolist() for column in columns), strict=True):
        if chunk < count:
            yield ListedChunk(chunk, *cells[:3], is_static=bool(cells[3]))


def listed_chunks(footer: bytes) -> Set[ChunkPlace] | None:
    """Return the positions of a file's chunks in Rerun's footer; None if the footer has another layout."""
    listed = set[ChunkPlace]()
    try:
        for number, manifest in read_fields(footer):
            if number == _MANIFESTS and isinstance(manifest, bytes):
                batch = _read_batch(bytes_fields(manifest)[_ROWS])
                places = (batch.column(name).to_pylist() for name in (_OFFSET, _LENGTH))
                listed |= {ChunkPlace(*place) for place in zip(*places, strict=True)}
    except (pa.ArrowException, ValueError, LookupError, TypeError, MemoryError):
        return None
    return listed


class _Part(NamedTuple):
    """Some rows of a column."""

    rows: NDArray[np.int64]
    numbers: NDArray[np.int64]


def _column_parts(store: _Store, chunks: NDArray[np.uint32]) -> Mapping[str, Sequence[_Part]]:
    """Return the non-empty rows of each column, without copying."""
    parts: dict[str, list[_Part]] = defaultdict(list)
    for layout, rows in store.rows.items():
        numbers = np.frombuffer(rows.numbers, np.int64).reshape(len(rows.chunks), -1)
        wanted, places = _rows_of(rows, chunks)
        for column, place in zip(layout.columns, layout.places, strict=True):
            parts[column].append(_Part(places, numbers[wanted, place]))
    return parts


def _rows_of(rows: _Rows, chunks: NDArray[np.uint32]) -> tuple[slice, NDArray[np.int64]]:
    """Return the rows of a layout that describe `chunks`, and the indices of these chunks."""
    numbers = np.frombuffer(rows.chunks, np.uint32)
    wanted = slice(int(np.searchsorted(numbers, chunks[-1], "right")) if len(chunks) else 0)
    return wanted, np.searchsorted(chunks, numbers[wanted])


def _entities(store: _Store, chunks: NDArray[np.uint32]) -> pa.Array:
    names = sorted({layout.entity for layout in store.rows})
    places = np.zeros(len(chunks), np.int32)
    for layout, rows in store.rows.items():
        places[_rows_of(rows, chunks)[1]] = names.index(layout.entity)
    return pa.array(names, pa.utf8()).take(pa.array(places))


def _column(field: pa.Field, parts: Mapping[str, Sequence[_Part]], count: int) -> pa.Array:
    numbers = np.zeros(count, np.int64)
    filled = np.zeros(count, bool)
    for part in parts.get(field.name, ()):
        numbers[part.rows], filled[part.rows] = part.numbers, True
    if pa.types.is_boolean(field.type):
        return pa.array(numbers.astype(bool))
    # Rerun writes 0 rows and empty times if a chunk does not have a column.
    validity = (
        None if pa.types.is_unsigned_integer(field.type) else pa.py_buffer(np.packbits(filled, bitorder="little"))
    )
    return pa.Array.from_buffers(field.type, count, [validity, pa.py_buffer(numbers)])


class _Cells(NamedTuple):
    """A column of times, counts or booleans."""

    numbers: NDArray[np.int64]
    filled: NDArray[np.bool_]
    """Mask of non-empty rows: those with a time, or with a count or boolean that is not zero."""


def _cells(column: pa.Array) -> _Cells:
    """Decode a column from its buffers, because there are hundreds in each block, and Arrow takes 0.06 ms for each."""
    validity, values = column.buffers()
    if pa.types.is_boolean(column.type):
        numbers = _bits(values, column).astype(np.int64)
        return _Cells(numbers, numbers != 0)
    numbers = np.frombuffer(values, np.int64, len(column), 8 * column.offset)
    if pa.types.is_unsigned_integer(column.type):
        return _Cells(numbers, numbers != 0)
    return _Cells(numbers, np.ones(len(column), bool) if validity is None else _bits(validity, column))


def _bits(buffer: pa.Buffer, column: pa.Array) -> NDArray[np.bool_]:
    bits = np.unpackbits(np.frombuffer(buffer, np.uint8), count=column.offset + len(column), bitorder="little")
    return bits[column.offset :].astype(bool)


def _read_batch(rows: bytes) -> pa.RecordBatch:
    values = {field.number: field.value for field in read_fields(rows)}
    payload = values[_PAYLOAD]
    size = values.get(_SIZE, 0)
    if not isinstance(payload, bytes) or not isinstance(size, int):
        raise TypeError("the table has another layout")
    stream = unpacked_lz4(payload, size) if values.get(_COMPRESSION) == _LZ4 else payload
    return read_table(stream, len(stream))


def _stream_bytes(batch: pa.RecordBatch) -> pa.Buffer:
    """Return a table as an Arrow stream, written once to memory of the right size."""
    counted = pa.MockOutputStream()
    _write(batch, counted)
    buffer = pa.allocate_buffer(counted.size())
    _write(batch, pa.FixedSizeBufferWriter(buffer))
    return buffer


def _write(batch: pa.RecordBatch, sink: pa.NativeFile) -> None:
    with pa.ipc.new_stream(sink, batch.schema) as writer:
        writer.write_batch(batch)
