"""A table of numpy columns that grows: a row is added in constant time, and all rows are read without copying."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import DTypeLike, NDArray

_FIRST_ROWS = 64


class GrowingTable:
    """A table that only grows; cells may be overwritten."""

    def __init__(self, dtypes: Mapping[str, DTypeLike]) -> None:
        """Make an empty table with one column per name."""
        self._arrays = {name: np.empty(_FIRST_ROWS, dtype) for name, dtype in dtypes.items()}
        self._capacity = _FIRST_ROWS
        self._length = 0

    def __len__(self) -> int:
        """Count the rows."""
        return self._length

    def __getitem__(self, name: str) -> NDArray:
        """Return a column as a view of its rows so far."""
        return self._arrays[name][: self._length]

    def append(self, **cells: float) -> int:
        """Add a row and return its index."""
        if self._length == self._capacity:
            self._grow()
        row = self._length
        for name, array in self._arrays.items():
            array[row] = cells[name]
        self._length += 1
        return row

    def _grow(self) -> None:
        # Doubling replaces the arrays, so a view that somebody still holds keeps its old rows unchanged.
        self._capacity *= 2
        self._arrays = {name: np.concatenate([array, np.empty_like(array)]) for name, array in self._arrays.items()}
