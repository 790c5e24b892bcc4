"""How much of a Parquet table may be in memory at once: a kilobyte of it can stand for terabytes.

A value that occurs again and again is stored once, and so are images that are all zero. Owns the limits.
"""

from collections.abc import Iterator, Sequence

import pyarrow.parquet as pq

from ltvn_core.errors import DriveError

_MOST_ROWS = 32
_BYTES_AT_ONCE = 2**28
_MOST_PART_BYTES = 2**29
"""Of a column in one group of rows; a whole file of a LeRobotDataset has a fifth of it."""
_MOST_NUMBERS = 1024
"""In a row of a column, as the joints of a robot."""


def rows_at_once(metadata: pq.FileMetaData, columns: Sequence[str]) -> int:
    """Return how many rows of some columns may be read together. Raises DriveError where one may be too much."""
    largest = 1
    for part, rows in _parts(metadata, columns):
        if part.total_uncompressed_size > _MOST_PART_BYTES or part.num_values > rows * _MOST_NUMBERS:
            raise DriveError(
                f"The column {part.path_in_schema!s:.80} unpacks to {part.total_uncompressed_size:,} bytes and "
                f"{part.num_values:,} values in {rows:,} rows, which no drive has."
            )
        largest = max(largest, part.total_uncompressed_size)
    # Each row may hold the column's largest value, which is at most as large as all of them.
    return max(1, min(_MOST_ROWS, _BYTES_AT_ONCE // largest))


def _parts(metadata: pq.FileMetaData, columns: Sequence[str]) -> Iterator[tuple[pq.ColumnChunkMetaData, int]]:
    """Yield the stored parts of some columns with the number of their rows."""
    for number in range(metadata.num_row_groups):
        group = metadata.row_group(number)
        for place in range(group.num_columns):
            part = group.column(place)
            if any(part.path_in_schema == name or part.path_in_schema.startswith(f"{name}.") for name in columns):
                yield part, group.num_rows
