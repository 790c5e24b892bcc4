"""Times and poses of the images of one run, as columns that grow.

Does not hold the images. A row is added in constant time, and all rows are read without copying.
"""

from bisect import bisect_right
from collections.abc import Mapping, Sequence

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
        """Return the number of rows."""
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

    def extend(self, columns: Mapping[str, NDArray]) -> None:
        """Add rows, given by columns of equal length."""
        until = self._length + len(next(iter(columns.values())))
        while self._capacity < until:
            self._grow()
        for name, array in self._arrays.items():
            array[self._length : until] = columns[name]
        self._length = until

    def _grow(self) -> None:
        # Doubling replaces the arrays, so that a view of the old arrays keeps its rows unchanged.
        self._capacity *= 2
        self._arrays = {name: np.concatenate([array, np.empty_like(array)]) for name, array in self._arrays.items()}


NO_TRAJECTORY = np.empty((0, 3))


class RecordedFrames:
    """Times and poses of the images of one run in time order; rows are only added."""

    def __init__(self) -> None:
        """Start without images."""
        self._steps: list[FrameId] = []
        self._stamps: list[float] = []
        self._driven = GrowingTable({"x": float, "y": float, "yaw": float})
        self._poses: dict[FrameId, Pose] = {}
        self._trajectory: tuple[tuple[int, int], NDArray[np.float64]] = ((0, 0), NO_TRAJECTORY)

    def __len__(self) -> int:
        """Return the number of images that were taken in this run."""
        return len(self._steps)

    def append(self, step: FrameId, stamp: float, pose: Pose) -> None:
        """Add an image taken at `stamp` seconds at `pose` (3,); a stamp before the last one counts as the last one."""
        self._steps.append(step)
        self._stamps.append(max(stamp, self._stamps[-1]) if self._stamps else stamp)
        self._driven.append(x=pose[0], y=pose[1], yaw=pose[2])
        self.place(step, pose)

    def extend(
        self, steps: Sequence[FrameId], stamps: Sequence[float], poses: Sequence[Pose], *, placed_until: FrameId
    ) -> None:
        """Add many images, each with its step, stamp and pose (3,); those up to the step `placed_until` are only
        placed."""
        self._poses.update(zip(steps, poses, strict=True))
        driven = np.array(steps) > placed_until
        self._steps += np.array(steps)[driven].tolist()
        times = np.array([*self._stamps[-1:], *np.array(stamps, float)[driven]])
        self._stamps[-1:] = np.maximum.accumulate(times).tolist()
        self._driven.extend(dict(zip(("x", "y", "yaw"), np.array(poses)[driven].T, strict=True)))

    def place(self, step: FrameId, pose: Pose) -> None:
        """Set the pose (3,) of an image that was not taken in this run: an image of the map with which it began."""
        self._poses[step] = pose

    def pose(self, step: FrameId) -> Pose | None:
        """Return the pose (3,) of an image; None if it is unknown."""
        return self._poses.get(step)

    def count_at(self, stamp: float) -> int:
        """Return the number of images up to `stamp` seconds. Takes logarithmic time."""
        return bisect_right(self._stamps, stamp)

    def step(self, row: int) -> FrameId:
        """Return the step of an image by its row."""
        return self._steps[row]

    def stamp(self, row: int) -> float:
        """Return the time of an image by its row, in seconds on the robot's clock."""
        return self._stamps[row]

    def driven_pose(self, row: int) -> Pose:
        """Return the pose (3,) of an image by its row."""
        return np.array([self._driven[name][row] for name in ("x", "y", "yaw")])

    def trajectory(self, count: int, most: int) -> NDArray[np.float64]:
        """Return the poses (T, 3) of the first `count` images, thinned to about `most`, always with the last one.

        A repeated call with the same arguments returns the same array, so that the caller can compare by identity.
        """
        if self._trajectory[0] != (count, most):
            stride = -(-count // most)
            rows = np.unique(np.r_[np.arange(0, count, stride), count - 1]) if count else np.empty(0, int)
            poses = np.stack([self._driven[name][rows] for name in ("x", "y", "yaw")], axis=1)
            self._trajectory = (count, most), poses
        return self._trajectory[1]
