"""Exact columns beside what the viewer draws: typed Arrow arrays in, numpy arrays out.

Owns how one row of numbers and texts goes into Rerun and comes back. Knows no entity and no meaning.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pyarrow as pa
import rerun as rr
from numpy.typing import NDArray


class _Column:
    """A component batch that is already Arrow; Rerun's own guessing of types is slow and remembers the first guess."""

    def __init__(self, array: pa.Array) -> None:
        self._array = array

    def as_arrow_array(self) -> pa.Array:
        return self._array


class ArchetypeColumns(rr.AsComponents):
    """One row of named columns under an archetype name, stored as `<archetype>:<column>`."""

    def __init__(self, archetype: str, columns: Mapping[str, pa.Array]) -> None:
        self._batches = [
            rr.DescribedComponentBatch(_Column(array), rr.ComponentDescriptor(name).with_builtin_archetype(archetype))
            for name, array in columns.items()
        ]

    def as_component_batches(self) -> list[rr.DescribedComponentBatch]:
        """Hand the columns to Rerun."""
        return self._batches


def text_column(*values: str) -> pa.Array:
    """Make a column of texts."""
    return pa.array(values, pa.utf8())


def integer_column(*values: int) -> pa.Array:
    """Make a column of 64-bit integers."""
    return pa.array(values, pa.int64())


def number_column(values: Any, dtype: type[np.generic] = np.float64) -> pa.Array:
    """Make a column of numbers from anything numpy can read. Always copies: the caller may reuse his array."""
    return pa.array(np.array(values, dtype).reshape(-1))


def read_cell(column: pa.Array, index: int) -> NDArray[Any]:
    """Return the numbers of one row of a list column, flat."""
    # `.values` of a sliced list would silently start at row 0; only `flatten` honours the offset.
    row = column.slice(index, 1).flatten()
    while pa.types.is_list(row.type) or pa.types.is_fixed_size_list(row.type):
        row = row.flatten()
    return row.to_numpy(zero_copy_only=False)
