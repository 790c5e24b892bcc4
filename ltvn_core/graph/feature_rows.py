"""A growing array with one row of features per image, in memory while it is small, then in a temporary file.

Owns the storage of the rows. `graph.keyframes` knows which image each row belongs to.
"""

import tempfile
import weakref
from typing import IO

import numpy as np

from ltvn_core.types import Features

MOST_IN_MEMORY = 2**27
"""Size in bytes above which the rows are memory-mapped from a file, so that only the pages in use need memory. An image
takes 23 kB."""
_FIRST_ROWS = 64


class FeatureRows:
    """An array with room for M rows."""

    def __init__(self, like: Features) -> None:
        """Start with rows of the shape and dtype of `like` (F,)."""
        self._array: Features = np.empty((_FIRST_ROWS, *like.shape), like.dtype)
        self._file: IO[bytes] | None = None

    @property
    def array(self) -> Features:
        """All rows (M, F), read-only; rows that were not written yet are undefined."""
        return self._array

    def put(self, place: int, row: Features) -> None:
        """Write one row (F,). Raises OSError if the disk is full."""
        while place >= len(self._array):
            self._grow()
        if self._file is None:
            self._array[place] = row
            return
        # Written to the file and not through the memory map, because there a full disk would kill the process.
        self._file.seek(place * row.nbytes)
        self._file.write(row.tobytes())
        self._file.flush()

    def _grow(self) -> None:
        """Double the capacity, so that the total cost of growing is linear."""
        count = 2 * len(self._array)
        if self._array.dtype.hasobject or 2 * self._array.nbytes <= MOST_IN_MEMORY:
            self._array = np.concatenate([self._array, np.empty_like(self._array)])
            return
        if self._file is None:
            self._file = tempfile.TemporaryFile()  # noqa: SIM115 (it lives as long as the rows)
            weakref.finalize(self, self._file.close)
            self._file.write(self._array.tobytes())
        self._file.truncate(2 * self._array.nbytes)
        shape = (count, *self._array.shape[1:])
        self._array = np.asarray(np.memmap(self._file, self._array.dtype, "r", shape=shape))
