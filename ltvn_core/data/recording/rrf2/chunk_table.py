"""Rerun's table of chunks (the manifests in its footer), which is assembled at the end of a recording.

Rerun makes a table for every block of messages that it returns. These are kept until the file ends, packed in groups,
because their columns repeat each other. No column is interpreted except the position of a chunk, and what the index of
the recording needs.
"""

import logging
from collections import defaultdict, deque
from collections.abc import Mapping, Sequence, Set
from typing import NamedTuple

import pyarrow as pa

from ltvn_core.data.recording import schema
from ltvn_core.data.recording.rrf2.layout import RECORDING_STORE, Manifest, read_manifests
from ltvn_core.data.recording.rrf2.sorbet_schema import SorbetSchema, as_rerun_merges

_LOG = logging.getLogger(__name__)
MOST_CELLS = 24_000_000
"""Largest number of cells (rows times columns) of a table, which needs some 25 bytes per cell while it is assembled.

A larger recording gets no table. The limit is about an hour of driving: 65,000 chunks and 354 columns.
"""
_GROUP = 16
"""Number of blocks whose tables are packed together."""
_CODEC = pa.Codec("zstd")
_ENTITY, _OFFSET, _LENGTH = "chunk_entity_path", "chunk_byte_offset", "chunk_byte_size"
_LISTED = ("chunk_num_rows", f"{schema.STEP}:start", f"{schema.STEP}:end", "chunk_is_static")
_ERRORS = (pa.ArrowException, ValueError, LookupError, TypeError, RuntimeError, MemoryError, OSError)


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


class _Store:
    """The tables of one store: the recording, or the viewer's layout."""

    def __init__(self) -> None:
        self.fields: dict[str, pa.Field] = {}
        """The columns by name."""
        self.schemas: dict[bytes, SorbetSchema] = {}
        """Rerun's schemas of the store's columns, by checksum."""
        self.newest: list[pa.Table] = []
        """Tables whose column of positions holds the numbers of the chunks instead."""
        self.packed: list[tuple[bytes, int]] = []
        """Earlier ones, as packed Arrow streams, and their unpacked size in bytes."""

    def add(self, chunks: pa.RecordBatch, numbers: Sequence[int]) -> None:
        """Append the table of a block, whose chunks have these numbers in the file."""
        self.fields |= {field.name: field for field in chunks.schema if field.name not in self.fields}
        place = chunks.schema.get_field_index(_OFFSET)
        columns = [*chunks.columns]
        columns[place] = pa.array(numbers, pa.uint64())
        # Not every block has each of the columns.
        optional = pa.schema([field.with_nullable(True).remove_metadata() for field in chunks.schema])
        self.newest.append(pa.Table.from_arrays(columns, schema=optional))
        if len(self.newest) == _GROUP:
            sink = pa.BufferOutputStream()
            (group,) = _joined(self.newest).combine_chunks().to_batches()
            with pa.ipc.new_stream(sink, group.schema) as writer:
                writer.write_batch(group)
            stream = sink.getvalue()
            self.packed.append((_CODEC.compress(stream, asbytes=True), stream.size))
            self.newest.clear()

    def chunks(self, places: Sequence[ChunkPlace]) -> pa.RecordBatch:
        """Return the rows of the chunks that are at `places`, in the order of the file."""
        streams = (_CODEC.decompress(packed, size) for packed, size in self.packed)
        whole = _joined([*(pa.ipc.open_stream(stream).read_all() for stream in streams), *self.newest])
        numbers = [number for number in whole.column(_OFFSET).to_pylist() if number < len(places)]
        arrays = list[pa.Array]()
        for field in self.fields.values():
            if field.name in (_OFFSET, _LENGTH):
                place = (_OFFSET, _LENGTH).index(field.name)
                arrays.append(pa.array([places[number][place] for number in numbers], field.type))
                continue
            column = whole.column(field.name).slice(0, len(numbers)).combine_chunks()
            # Rerun writes 0 rows, False, and empty times if a chunk does not have a column.
            if pa.types.is_unsigned_integer(field.type):
                column = column.fill_null(0)
            elif pa.types.is_boolean(field.type):
                column = column.fill_null(False)
            arrays.append(column)
        return pa.RecordBatch.from_arrays(arrays, schema=pa.schema(list(self.fields.values())))


class ChunkTable:
    """Collects the tables of blocks, and encodes the table of the file. One thread may call `add` while another calls
    `take_in`."""

    def __init__(self) -> None:
        """Begin with nothing."""
        self._waiting: deque[tuple[bytes, Sequence[int]]] = deque()
        self._stores: dict[bytes, _Store] = defaultdict(_Store)
        self._listed: dict[str, list[ListedChunk]] = defaultdict(list)
        """The chunks that are read back, by entity."""
        self._count = 0
        self._incomplete = False

    def add(self, footer: bytes, offsets: Sequence[int]) -> None:
        """Queue the footer of a block, with the offsets of its chunks' payloads in the block. Fast, because nothing is
        decoded yet."""
        self._waiting.append((footer, offsets))

    def take_in(self) -> None:
        """Decode the queued footers, in some milliseconds per block. Never raises: at worst the file gets no table."""
        while self._waiting and not self._incomplete:
            footer, offsets = self._waiting.popleft()
            number_of = {offset: self._count + place for place, offset in enumerate(offsets)}
            try:
                for manifest in read_manifests(footer):
                    self._read(manifest, number_of)
                if number_of:
                    raise ValueError(f"{len(number_of)} chunks are not in the table")
            except _ERRORS:
                _LOG.warning(
                    "The recording will have no table of chunks: the layout of Rerun's own table is unknown.",
                    exc_info=True,
                )
                self._incomplete = True
            self._count += len(offsets)

    def encoded(self, places: Sequence[ChunkPlace]) -> bytes:
        """Return Rerun's footer for a file with the chunks that were added first, which are at `places`.

        Empty if any of these chunks was in no table, or if there are too many. Never raises, like `take_in`.
        """
        self.take_in()
        cells = sum(len(store.fields) * len(places) for store in self._stores.values())
        if self._incomplete or not places or len(places) > self._count or cells > MOST_CELLS:
            return b""
        try:
            return b"".join(_manifest(key, store, places) for key, store in self._stores.items())
        except _ERRORS:
            _LOG.warning("The recording has no table of chunks: it could not be made.", exc_info=True)
            return b""

    def listed(self, count: int) -> Mapping[str, Sequence[ListedChunk]] | None:
        """Return those of the first `count` chunks that are read back, by entity; None if any chunk was in no table."""
        self.take_in()
        if self._incomplete or count > self._count:
            return None
        return {entity: [each for each in chunks if each.number < count] for entity, chunks in self._listed.items()}

    def _read(self, manifest: Manifest, number_of: dict[int, int]) -> None:
        """Keep the table of a store, and take its chunks, by offset, out of `number_of`."""
        store, chunks = self._stores[manifest.store], manifest.chunks
        known = SorbetSchema(manifest.schema, manifest.schema_sha256)
        store.schemas.setdefault(known.sha256, known)
        numbers = [number_of.pop(offset) for offset in chunks.column(_OFFSET).to_pylist()]
        if numbers != sorted(numbers):
            raise ValueError("chunks in another order")
        store.add(chunks, numbers)
        if manifest.store.startswith(RECORDING_STORE):
            absent = [None] * len(numbers)
            columns = [chunks.column(name).to_pylist() if name in chunks.schema.names else absent for name in _LISTED]
            for number, entity, *cells in zip(numbers, chunks.column(_ENTITY).to_pylist(), *columns, strict=True):
                if schema.is_read_back(entity):
                    rows, first, last, is_static = (cell or 0 for cell in cells)
                    self._listed[entity].append(ListedChunk(number, rows, first, last, is_static=bool(is_static)))


def listed_chunks(footer: bytes) -> Set[ChunkPlace] | None:
    """Return the positions of a file's chunks in Rerun's footer; None if the footer has another layout."""
    try:
        tables = [manifest.chunks for manifest in read_manifests(footer)]
        columns = ([table.column(name).to_pylist() for name in (_OFFSET, _LENGTH)] for table in tables)
        return {ChunkPlace(*place) for each in columns for place in zip(*each, strict=True)}
    except _ERRORS:
        return None


def _manifest(key: bytes, store: _Store, places: Sequence[ChunkPlace]) -> bytes:
    merged = as_rerun_merges(list(store.schemas.values()))
    manifest = Manifest(key, merged.encoded, merged.sha256, store.chunks(places))
    pa.default_memory_pool().release_unused()  # Of the tables before they were joined.
    return manifest.encoded()


def _joined(tables: Sequence[pa.Table]) -> pa.Table:
    return pa.concat_tables(tables, promote_options="default")
