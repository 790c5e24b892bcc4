"""The schema of all columns of a recording (Rerun's "sorbet schema") and its checksum, both made by Rerun.

Rerun encodes one artificial row for each type of column, so that its merging and hashing need not be repeated here.
"""

from collections import defaultdict
from collections.abc import Sequence
from typing import NamedTuple

import pyarrow as pa
import rerun as rr
from rerun.chunk import Chunk

from ltvn_core.data.recording import schema
from ltvn_core.data.recording.rrf2.layout import MESSAGE_HEADER, messages, read_manifests
from ltvn_core.data.recording.stream_lock import STREAM_LOCK

_KIND, _STATIC, _EMPTY = b"rerun:kind", b"rerun:is_static", b"rerun:is_semantically_empty"
_TIMEOUT_S = 10.0


class SorbetSchema(NamedTuple):
    """Rerun's encoded schema of a store."""

    encoded: bytes
    """Schema in Arrow IPC format."""
    sha256: bytes
    """Message with Rerun's checksum of the schema."""


def as_rerun_merges(schemas: Sequence[SorbetSchema]) -> SorbetSchema:
    """Return the schema of a store, merged by Rerun from the `schemas` of its blocks. Raises RuntimeError or
    ArrowException."""
    if len(schemas) == 1:
        return schemas[0]
    chunks = _examples([field for each in schemas for field in pa.ipc.read_schema(pa.py_buffer(each.encoded))])
    with STREAM_LOCK:
        rerun = rr.RecordingStream(schema.APPLICATION_ID)
    stream = rerun.binary_stream()
    rerun.send_chunks(chunks)
    block = stream.read(flush=True, flush_timeout_sec=_TIMEOUT_S)
    rerun.disconnect()
    if not block:
        raise RuntimeError("Rerun did not encode the examples")
    *_, (_, begin, end) = messages(block)
    (manifest,) = read_manifests(block[begin + MESSAGE_HEADER.size : end])
    return SorbetSchema(manifest.schema, manifest.schema_sha256)


def _examples(fields: Sequence[pa.Field]) -> list[Chunk]:
    """Return chunks of one row each that together contain every field."""
    times = list({field.name: field for field in fields if _metadata(field).get(_KIND) == b"index"}.values())
    # Columns with the same name, whose types differ between blocks, are in different chunks.
    groups: dict[tuple[bool, bool, int], list[pa.Field]] = defaultdict(list)
    seen: dict[str, list[pa.Field]] = defaultdict(list)
    for field in fields:
        about = _metadata(field)
        if about.get(_KIND) != b"data" or any(field.equals(other, check_metadata=True) for other in seen[field.name]):
            continue
        seen[field.name].append(field)
        groups[_STATIC in about, _EMPTY in about, len(seen[field.name])].append(field)
    chunks = list[Chunk]()
    for (is_static, is_empty, _), columns in groups.items():
        indexes = [] if is_static else times
        cells = [pa.nulls(1, column.type) if is_empty else _zero(column.type) for column in columns]
        row = pa.RecordBatch.from_arrays(
            [*(pa.array([0], index.type) for index in indexes), *cells], schema=pa.schema([*indexes, *columns])
        )
        chunks += Chunk.from_record_batch(row, index=None) if is_static else Chunk.from_record_batch(row)
    return chunks


def _zero(kind: pa.DataType) -> pa.Array:
    """Return one non-empty value of a type."""
    if pa.types.is_fixed_size_list(kind):
        values = pa.concat_arrays([_zero(kind.value_type)] * kind.list_size)
        return pa.FixedSizeListArray.from_arrays(values, type=kind)
    if pa.types.is_list(kind):
        return pa.ListArray.from_arrays(pa.array([0, 1], pa.int32()), _zero(kind.value_type), type=kind)
    if pa.types.is_struct(kind):
        return pa.StructArray.from_arrays([_zero(field.type) for field in kind], fields=list(kind))
    if pa.types.is_string(kind) or pa.types.is_binary(kind):
        return pa.array([""]).cast(kind)
    if pa.types.is_boolean(kind):
        return pa.array([False])
    if pa.types.is_union(kind) or pa.types.is_null(kind):
        return pa.nulls(1, kind)
    return pa.array([0]).cast(kind)


def _metadata(field: pa.Field) -> dict[bytes, bytes]:
    return field.metadata or {}
