"""Rows of numbers, one an image, in an array that grows: in memory while it is small, then in a file without a name.

Owns where the rows are kept. Does not know which image a row belongs to: `graph.keyframes` does.
"""

import tempfile
import weakref
from typing import IO

import numpy as np

from ltvn_core.types import Features

MOST_IN_MEMORY = 2**27
"""Bytes; rows that take more are in a file, of which the system keeps in memory what is used. 23 kB an image."""
_FIRST_ROWS = 64


class FeatureRows:
    """An array with room for M rows."""

    def __init__(self, like: Features) -> None:
        """Begin with rows of the shape and kind of `like` (F,)."""
        self._array: Features = np.empty((_FIRST_ROWS, *like.shape), like.dtype)
        self._file: IO[bytes] | None = None

    @property
    def array(self) -> Features:
        """(M, F), not to be written to; rows that were never put mean nothing."""
        return self._array

    def put(self, place: int, row: Features) -> None:
        """Write one row (F,). Raises OSError where the disk is full."""
        while place >= len(self._array):
            self._grow()
        if self._file is None:
            self._array[place] = row
            return
        # Written as a file and not through the map, where a full disk would kill the process.
        self._file.seek(place * row.nbytes)
        self._file.write(row.tobytes())
        self._file.flush()

    def _grow(self) -> None:
        """Make room for twice as many rows, which keeps the cost of growing linear."""
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
