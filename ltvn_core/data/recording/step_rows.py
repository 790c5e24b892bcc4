"""Finds the row of a step among the batches of an entity, which may be read only when they are asked for."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from ltvn_core.data.recording import schema
from ltvn_core.data.recording.stored_rows import BatchRow
from ltvn_core.errors import RecordingError
from ltvn_core.types import FrameId


def wrong_index(what: str) -> RecordingError:
    """Return the error for an index that differs from the rows of its file."""
    return RecordingError(
        f"The recording's index is wrong: {what}. Run `ltvn repair FILE --output NEW.rrd`, which reads without it."
    )


@dataclass(frozen=True, slots=True, eq=False)
class StepRows:
    """The rows of an entity that has at most one valid row for each step."""

    batches: Sequence[pa.RecordBatch]
    steps: NDArray[np.int64]
    """Steps (N,), ascending."""
    numbers: NDArray[np.int64]
    """Number (N,) of each step's row among the rows of all batches."""
    starts: NDArray[np.int64]
    """Number (B + 1,) of the first row of each batch; at the end, the number of rows."""

    @classmethod
    def of(cls, batches: Sequence[pa.RecordBatch]) -> Self:
        """Read the steps of all batches; of several rows with the same step, the last one counts."""
        steps = [np.empty(0, np.int64)]
        steps += [batch.column(schema.STEP).to_numpy(zero_copy_only=False) for batch in batches]
        return cls.known(batches, np.concatenate(steps), [len(each) for each in steps[1:]])

    @classmethod
    def known(
        cls, batches: Sequence[pa.RecordBatch], steps: NDArray[np.int64], rows: Sequence[int] | NDArray[np.int64]
    ) -> Self:
        """Take the steps (M,) of all rows in the order of the file, and the number of rows (B,) of each batch."""
        ascending, from_end = np.unique(steps[::-1], return_index=True)
        return cls(batches, ascending, len(steps) - 1 - from_end, np.cumsum([0, *rows]))

    def row(self, step: FrameId) -> BatchRow | None:
        """Return the row of a step; None if it has none. Raises RecordingError if the index names another's."""
        place = int(np.searchsorted(self.steps, step))
        if place == len(self.steps) or self.steps[place] != step:
            return None
        number = int(self.numbers[place])
        batch = int(np.searchsorted(self.starts, number, "right")) - 1
        row = BatchRow(self.batches[batch], number - int(self.starts[batch]))
        if row.step != step:
            raise wrong_index(f"at the place of frame {step} is frame {row.step}")
        return row

    def numbers_of(self, steps: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the row numbers (N,) of steps (N,) that all have a row."""
        return self.numbers[np.searchsorted(self.steps, steps)]
