"""When and where the images of one run were taken, as columns that grow.

Owns times and poses; the images themselves are elsewhere. A row is added in constant time, and all rows are read
without copying.
"""

from bisect import bisect_right
from collections.abc import Mapping

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ltvn_core.types import FrameId, Pose

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


NO_TRAJECTORY = np.empty((0, 3))


class RecordedFrames:
    """The images of one run in the order of their times; it only grows."""

    def __init__(self) -> None:
        """Begin without images."""
        self._steps: list[FrameId] = []
        self._stamps: list[float] = []
        self._driven = GrowingTable({"x": float, "y": float, "yaw": float})
        self._poses: dict[FrameId, Pose] = {}
        self._trajectory: tuple[tuple[int, int], NDArray[np.float64]] = ((0, 0), NO_TRAJECTORY)

    def __len__(self) -> int:
        """Count the images that were taken while driving."""
        return len(self._steps)

    def append(self, step: FrameId, stamp: float, pose: Pose) -> None:
        """Add an image taken at `stamp` seconds at `pose` (3,); time never runs back."""
        self._steps.append(step)
        self._stamps.append(max(stamp, self._stamps[-1]) if self._stamps else stamp)
        self._driven.append(x=pose[0], y=pose[1], yaw=pose[2])
        self.place(step, pose)

    def place(self, step: FrameId, pose: Pose) -> None:
        """Say where an image was taken, (3,), that this run did not take: one of a map that it began with."""
        self._poses[step] = pose

    def pose(self, step: FrameId) -> Pose | None:
        """Return where an image was taken, (3,); None if unknown."""
        return self._poses.get(step)

    def count_at(self, stamp: float) -> int:
        """Return how many images were taken up to `stamp` seconds. Logarithmic."""
        return bisect_right(self._stamps, stamp)

    def step(self, row: int) -> FrameId:
        """Return the step of an image by its row."""
        return self._steps[row]

    def stamp(self, row: int) -> float:
        """Return the time of an image by its row, seconds on the robot's clock."""
        return self._stamps[row]

    def driven_pose(self, row: int) -> Pose:
        """Return where an image was taken by its row, (3,)."""
        return np.array([self._driven[name][row] for name in ("x", "y", "yaw")])

    def trajectory(self, count: int, most: int) -> NDArray[np.float64]:
        """Return (T, 3) poses of the first `count` images, thinned to about `most`, always including the last.

        While the robot does not move the same array is returned, so that comparing by identity shows that nothing
        changed.
        """
        if self._trajectory[0] != (count, most):
            stride = -(-count // most)
            rows = np.unique(np.r_[np.arange(0, count, stride), count - 1]) if count else np.empty(0, int)
            poses = np.stack([self._driven[name][rows] for name in ("x", "y", "yaw")], axis=1)
            self._trajectory = (count, most), poses
        return self._trajectory[1]
