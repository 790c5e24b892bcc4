"""Layout of a message with a chunk of rows."""

from typing import NamedTuple

import pyarrow as pa

from ltvn_core.data.recording.rrf2.arrow_tables import read_table, unpacked_lz4
from ltvn_core.protobuf_fields import bytes_fields, read_fields

_STORE, _COMPRESSION, _SIZE, _TABLE = 1, 2, 3, 5
_LZ4 = 2
_RECORDING_ID = 2
"""Field of a store that holds the id of the recording."""
_ENTITY = b"rerun:entity_path"


class ChunkMessage(NamedTuple):
    """The rows of one message."""

    store: bytes
    """Rerun's key of the recording, or of the viewer's layout, to which the rows belong."""
    entity: str
    batch: pa.RecordBatch


def read_chunk(payload: bytes) -> ChunkMessage:
    """Decode a message without its header; nothing in it is trusted.

    Raises OSError, ValueError, LookupError, TypeError or ArrowException if it holds no chunk.
    """
    fields = {each.number: each.value for each in read_fields(payload)}
    store, table, size = fields[_STORE], fields[_TABLE], fields.get(_SIZE, 0)
    if not isinstance(store, bytes) or not isinstance(table, bytes) or not isinstance(size, int):
        raise TypeError("its layout is unknown")
    if fields.get(_COMPRESSION) == _LZ4:
        table = unpacked_lz4(table, size)
    batch = read_table(table, len(table))
    return ChunkMessage(store, (batch.schema.metadata or {}).get(_ENTITY, b"").decode(), batch)


def recording_id(store: bytes) -> str:
    """Return the id of the recording in the key of a store. Raises ValueError or LookupError if it has none."""
    return bytes_fields(store)[_RECORDING_ID].decode()
