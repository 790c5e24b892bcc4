"""Rows whose columns stand in several chunks, put together again.

Rerun's tools (`rerun rrd optimize`) may put the columns of an entity into chunks of their own, several rows in each and
in any order. What belongs together has the same row id; a step does not tell, since events share steps.
"""

from collections.abc import Sequence, Set

import pyarrow as pa

ROW_ID = "rerun.controls.RowId"


def joined_rows(batches: Sequence[pa.RecordBatch], needed: Set[str]) -> Sequence[pa.RecordBatch]:
    """Return batches in which every row has all of its columns, and stands once.

    Rows that lack a needed column everywhere are left out. Batches in which nothing has to be joined stay as they are.
    """
    if not all(ROW_ID in batch.schema.names for batch in batches):
        return batches
    ids = [batch.column(ROW_ID).to_pylist() for batch in batches]
    every = list(dict.fromkeys(row_id for part in ids for row_id in part))
    if len(every) == sum(map(len, ids)) and all(_is_whole(batch, needed) for batch in batches):
        return batches
    fields = {field.name: field for batch in batches for field in batch.schema}
    columns = {ROW_ID: pa.array(every, pa.binary(16))}
    for name in fields.keys() - {ROW_ID}:
        columns[name] = _column(name, batches, ids, every)
    if not needed <= columns.keys():
        return ()
    joined = pa.RecordBatch.from_arrays(list(columns.values()), names=list(columns))
    lacking = {row for name in needed for row, cell in enumerate(columns[name].is_valid().to_pylist()) if not cell}
    return [joined.take(pa.array([row for row in range(len(every)) if row not in lacking], pa.int64()))]


def _is_whole(batch: pa.RecordBatch, needed: Set[str]) -> bool:
    return needed <= set(batch.schema.names) and not any(batch.column(name).null_count for name in needed)


def _column(
    name: str, batches: Sequence[pa.RecordBatch], ids: Sequence[Sequence[bytes]], every: Sequence[bytes]
) -> pa.Array:
    """Return a column for the rows `every`, empty where no batch holds anything."""
    pieces, places = list[pa.Array](), dict[bytes, int]()
    start = 0
    for batch, row_ids in zip(batches, ids, strict=True):
        if name not in batch.schema.names:
            continue
        pieces.append(batch.column(name))
        filled = pieces[-1].is_valid().to_pylist()
        places |= {row_id: start + row for row, row_id in enumerate(row_ids) if filled[row]}
        start += batch.num_rows
    return pa.concat_arrays(pieces).take(pa.array([places.get(row_id) for row_id in every], pa.int64()))
