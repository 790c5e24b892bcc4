"""A table of odometry as people export it: `file` or `stamp`, `x`, `y`, `yaw`, with or without a heading.

Owns reading it and finding the row of a picture: by its file's name, by its stamp, or by its place.
"""

import csv
import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ltvn_core.errors import DriveError
from ltvn_core.importing.stamp_matching import period_s
from ltvn_core.importing.text_lists import read_list
from ltvn_core.types import Pose

_COLUMNS = 4
_LEAST_SLACK_S = 0.02
_KEYS = ("file", "filename", "image", "stamp", "timestamp", "time", "t")
_HOW_TO = "it needs the columns file (or stamp in seconds), x, y in metres, and yaw in radians"


class OdometryTable:
    """Rows of odometry."""

    def __init__(self, name: str, keys: Sequence[str], poses: Pose) -> None:
        """Take N keys, names of files or stamps, and poses (N, 3)."""
        self.name = name
        self._poses = poses
        self._stamps = _numbers(keys)
        self._places = {Path(key).name: place for place, key in enumerate(keys)}
        self._stems = {Path(key).stem: place for place, key in enumerate(keys)}

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self._poses)

    @classmethod
    def read(cls, path: Path) -> "OdometryTable":
        """Read a CSV file. Raises DriveError that names the first line that cannot be right."""
        try:
            lines = csv.reader(io.StringIO(read_list(path, "table of odometry"), newline=""))
            rows = [row for row in lines if row and not row[0].startswith("#")]
        except csv.Error as error:
            raise DriveError(f"{path} cannot be read as a table ({error!s:.120}); {_HOW_TO}.") from error
        return cls(path.name, *_parsed(rows, path))

    def stamps_by_place(self, images: int) -> list[float] | None:
        """Return the stamps of as many pictures in order; None where rows have no stamps or are not as many."""
        if self._stamps is None or len(self._poses) != images or not (np.diff(self._stamps) > 0).all():
            return None
        return self._stamps.tolist()

    def pose(self, file: str, stamp: float, place: int) -> Pose | None:
        """Return the pose (3,) of a picture by its file's name, its stamp, or its place; None where no row fits."""
        row = self._places.get(file, self._stems.get(Path(file).stem))
        if row is None and self._stamps is not None:
            row = self._row_at(stamp)
        return None if row is None else self._poses[row]

    def _row_at(self, stamp: float) -> int | None:
        assert self._stamps is not None  # Asked for where there are some.
        row = int(np.argmin(np.abs(self._stamps - stamp)))
        slack_s = max((period_s(self._stamps) or 0.0) / 2, _LEAST_SLACK_S)
        return row if abs(self._stamps[row] - stamp) <= slack_s else None


def _parsed(rows: list[list[str]], path: Path) -> tuple[list[str], Pose]:
    order = list(range(_COLUMNS))
    if rows and _numbers(rows[0][1:_COLUMNS]) is None:
        order = _columns([name.strip().lower() for name in rows.pop(0)], path)
    keys: list[str] = []
    poses: list[list[float]] = []
    for number, row in enumerate(rows, start=1):
        try:
            keys.append(row[order[0]].strip())
            poses.append([float(row[column]) for column in order[1:]])
        except (IndexError, ValueError) as error:
            raise DriveError(f"{path}, row {number} is {','.join(row)!s:.60}; {_HOW_TO}.") from error
    if not poses:
        raise DriveError(f"{path} holds no rows; {_HOW_TO}.")
    return keys, np.array(poses)


def _columns(names: list[str], path: Path) -> list[int]:
    try:
        key = next(names.index(name) for name in _KEYS if name in names)
        return [key, *(names.index(name) for name in ("x", "y", "yaw"))]
    except (StopIteration, ValueError) as error:
        raise DriveError(f"{path} has the columns {', '.join(names)!s:.80}; {_HOW_TO}.") from error


def _numbers(texts: Sequence[str]) -> np.ndarray | None:
    try:
        numbers = np.array([float(text) for text in texts])
    except ValueError:
        return None
    return numbers if np.isfinite(numbers).all() else None
