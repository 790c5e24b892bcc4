"""A trajectory in space as others write it: `stamp tx ty tz qx qy qz qw` a line, turned so that z is up.

Owns reading such files (TUM's format, which evo, ORB-SLAM and RTAB-Map write too), interpolation, and finding out which
axis of the world is up.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from ltvn_core.errors import DriveError
from ltvn_core.importing.spatial_pose import SpatialPose, spatial_pose
from ltvn_core.importing.stamp_matching import period_s
from ltvn_core.importing.text_lists import list_lines

LARGEST_GAP_S = (0.25, 1.0)
"""Between samples that are farther apart nothing is known: the first, or twice their usual distance up to the
second."""

_COLUMNS = 8
_UPRIGHT = 0.25
"""Where the camera's up is within 75 degrees of z on average, z is up, as nearly always; it may look down steeply."""
_CLEARLY_UP = 0.8
"""Else the axis is up that is so near to the camera's up on average, as the cosine."""
_UNIT_TOLERANCE = 0.1
_BESIDE_S = 0.025
"""A sample so near in time is the pose, where there is none on the other side."""
_SECONDS_BELOW = 1e11
"""Stamps are in seconds below this, the year 5138."""
_UNITS = (("milliseconds", 1e-3), ("microseconds", 1e-6), ("nanoseconds", 1e-9))
_AXES = {"z": (0, 0, 1), "-y": (0, -1, 0), "y": (0, 1, 0), "-z": (0, 0, -1)}
"""What programs take for up: z in robotics, -y where the world is the first camera, y in graphics."""


class StampedLines(NamedTuple):
    """A list of stamps and what belongs to each."""

    rows: Sequence[tuple[float, list[str]]]
    """Stamps in seconds, in rising order, and the words that follow."""
    doubt: str | None
    """Says that the stamps of the file are in another unit."""


class StampedPoses(NamedTuple):
    """Poses of one file."""

    stamps: NDArray[np.float64]
    """(N,) seconds, rising."""
    positions: NDArray[np.float64]
    """(N, 3) metres."""
    rotations: Rotation
    """N of them, from the frame whose pose it is to the world."""
    doubt: str | None
    """What is doubtful of the stamps."""


class PoseTrack:
    """Poses of a camera's optical frame over time."""

    def __init__(
        self,
        stamps: NDArray[np.float64],
        positions: NDArray[np.float64],
        rotations: Rotation,
        doubt: str | None = None,
        *,
        up_axis: str | None = None,
    ) -> None:
        """Take N stamps in rising order, positions (N, 3) in metres and as many rotations, optical to world.

        `up_axis` is "z" where the source says so; without, it is found out.
        """
        self.stamps = stamps
        self.doubt = doubt
        """What is doubtful of its stamps."""
        self.up_axis = up_axis or _up_axis(rotations)
        """Which axis of the source's world is up; positions and rotations are turned so that it is z."""
        turn = Rotation.align_vectors([[0, 0, 1]], [_AXES[self.up_axis]])[0] if self.up_axis != "z" else None
        self._positions = positions if turn is None else turn.apply(positions)
        self._rotations = rotations if turn is None else turn * rotations
        least_s, most_s = LARGEST_GAP_S
        self._largest_gap_s = min(max(least_s, 2 * (period_s(stamps) or 0.0)), most_s)
        self._slerp = Slerp(stamps, self._rotations) if len(stamps) > 1 else None

    @classmethod
    def read(cls, path: Path) -> "PoseTrack":
        """Read a file. Raises DriveError that names the first line that cannot be right."""
        return cls(*read_poses(path))

    def at(self, stamp: float) -> SpatialPose | None:
        """Return the pose at a time, between samples in proportion; None where there is no sample nearby."""
        after = int(np.searchsorted(self.stamps, stamp))
        if after < len(self.stamps) and self.stamps[after] == stamp:
            return self._sample(after)
        if not 0 < after < len(self.stamps) or self.stamps[after] - self.stamps[after - 1] > self._largest_gap_s:
            return self._nearest(stamp)
        before_s, after_s = self.stamps[after - 1], self.stamps[after]
        share = (stamp - before_s) / (after_s - before_s)
        position = (1 - share) * self._positions[after - 1] + share * self._positions[after]
        assert self._slerp is not None  # There are two samples.
        return spatial_pose(position, self._slerp(stamp).as_matrix())

    def _nearest(self, stamp: float) -> SpatialPose | None:
        place = int(np.argmin(np.abs(self.stamps - stamp)))
        return self._sample(place) if abs(self.stamps[place] - stamp) <= _BESIDE_S else None

    def _sample(self, place: int) -> SpatialPose:
        return spatial_pose(self._positions[place], self._rotations[place].as_matrix())


def stamped_lines(path: Path, *, least_columns: int, unit_s: float | None = None) -> StampedLines:
    """Return the lines of a text file as stamps and the words that follow, in the order of the stamps.

    Lines that begin with # are comments. Stamps are in units of `unit_s` seconds; without it, those in thousandths of a
    second or less are recognised by their size. Raises DriveError that names the first line that cannot be right.
    """
    lines: list[tuple[float, list[str]]] = []
    for number, line, words in list_lines(path, "list of images or poses"):
        try:
            stamp = float(words[0])
        except ValueError:
            stamp = np.nan
        if not np.isfinite(stamp) or len(words) < least_columns:
            raise DriveError(
                f"{path}, line {number}: expected a stamp in seconds and {least_columns - 1} more columns, got "
                f"{line!s:.60}."
            )
        lines.append((stamp, words[1:]))
    rows = sorted(lines, key=lambda line: line[0])
    if unit_s is not None:
        return StampedLines([(stamp * unit_s, words) for stamp, words in rows], None)
    return _in_seconds(rows, path)


def _in_seconds(rows: list[tuple[float, list[str]]], path: Path) -> StampedLines:
    middle = abs(rows[len(rows) // 2][0]) if rows else 0.0
    if middle < _SECONDS_BELOW:
        return StampedLines(rows, None)
    name, unit_s = next((each for each in _UNITS if middle * each[1] < _SECONDS_BELOW), _UNITS[-1])
    doubt = f"The stamps of {path.name} are too large for seconds ({middle:.0f}), and were read as {name}."
    return StampedLines([(stamp * unit_s, words) for stamp, words in rows], doubt)


def read_poses(path: Path, *, scalar_first: bool = False, unit_s: float | None = None) -> StampedPoses:
    """Read lines of a stamp, a position and a quaternion; of lines with one stamp the first.

    Args:
        path: The file, as `stamped_lines` reads it; further columns are passed over.
        scalar_first: Whether w is the first of the quaternion's columns, and not the last.
        unit_s: Seconds that a stamp counts; found out by its size without.

    Raises:
        DriveError: The file holds no poses, or one that cannot be right, which is named.
    """
    columns = f"stamp tx ty tz {'qw qx qy qz' if scalar_first else 'qx qy qz qw'}"
    lines, doubt = stamped_lines(path, least_columns=_COLUMNS, unit_s=unit_s)
    if not lines:
        raise DriveError(f"{path} holds no poses; it needs lines of {columns}.")
    try:
        numbers = np.array([[stamp, *map(float, words[: _COLUMNS - 1])] for stamp, words in lines])
    except ValueError as error:
        raise DriveError(f"{path}: a pose is no row of numbers ({error!s:.80}).") from error
    numbers = numbers[np.unique(numbers[:, 0], return_index=True)[1]]
    norms = np.linalg.norm(numbers[:, 4:], axis=1)
    wrong = ~np.isfinite(numbers).all(axis=1) | (np.abs(norms - 1) > _UNIT_TOLERANCE)
    if wrong.any():
        raise DriveError(
            f"{path}: the pose at {numbers[np.argmax(wrong), 0]} is not finite, or its quaternion is not of length 1; "
            f"the columns are {columns}."
        )
    rotations = Rotation.from_quat(numbers[:, [5, 6, 7, 4] if scalar_first else [4, 5, 6, 7]])
    return StampedPoses(numbers[:, 0], numbers[:, 1:4], rotations, doubt)


def _up_axis(rotations: Rotation) -> str:
    """Return the axis of the world that is up, for a camera that is carried upright for the most part."""
    up = rotations.apply([0.0, -1.0, 0.0]).mean(axis=0)
    length = np.linalg.norm(up)
    if length == 0 or up[2] / length >= _UPRIGHT:
        return "z"
    best = max(_AXES, key=lambda name: float(up @ _AXES[name]))
    return best if float(up @ _AXES[best]) / length >= _CLEARLY_UP else "z"
