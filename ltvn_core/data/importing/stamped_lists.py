"""Lists from other programs, one row per line: trajectories, images with their times, tables of odometry.

Owns the decoding of such a text, the lines that count and their largest number, the unit of the stamps, and the
matching of stamps between two lists. A table of odometry has `file` or `stamp`, `x`, `y`, `yaw`, with or without a
header; the row of a picture is found by its file name or its stamp.
"""

import codecs
import csv
import io
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ltvn_core.data.importing.foreign_files import read_foreign
from ltvn_core.errors import DriveError
from ltvn_core.types import Pose

MOST_LINES = 1_000_000
"""Largest number of lines: nine hours at 30 images per second. Longer drives must be imported in parts."""
RATE_HZ = 10.0
"""Assumed number of images per second if there are no stamps."""
_MOST_BYTES = 100_000_000
_UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
"""Byte order marks of UTF-16, which PowerShell on Windows writes."""
_SECONDS_BELOW = 1e11
"""Largest value of a stamp in seconds, in the year 5138; larger values have a smaller unit."""
_UNITS = (("milliseconds", 1e-3), ("microseconds", 1e-6), ("nanoseconds", 1e-9))
_TABLE_COLUMNS = 4
_LEAST_SLACK_S = 0.02
_KEYS = ("file", "filename", "image", "stamp", "timestamp", "time", "t")
_TABLE_NEEDS = "it needs the columns file (or stamp in seconds), x, y in metres, and yaw in radians"


def _read_list(path: Path, what: str) -> str:
    """Return the text of a list.

    Args:
        path: The file, in UTF-8 or UTF-16.
        what: Kind of file in messages, such as "list of poses".

    Raises:
        DriveError: The file cannot be read as text, or is too long for such a list.
    """
    try:
        blob = read_foreign(path, most_bytes=_MOST_BYTES, what=what)
        text = blob.decode("utf-16" if blob.startswith(_UTF_16) else "utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise DriveError(f"{path} cannot be read as text ({error!s:.120}).") from error
    if max(text.count("\n"), text.count("\r")) > MOST_LINES:
        raise DriveError(
            f"{path} has more than {MOST_LINES:,} lines, which is too many for a {what}; import the drive in parts."
        )
    return text


def list_lines(path: Path, what: str) -> Iterator[tuple[int, str, list[str]]]:
    """Yield number, text and words of each line that is neither empty nor a comment (#); line numbers begin at 1.

    White space or commas separate words. Raises DriveError as `_read_list` does.
    """
    for number, line in enumerate(_read_list(path, what).splitlines(), start=1):
        words = line.replace(",", " ").split()
        if words and not words[0].startswith("#"):
            yield number, line, words


def stamped_lines(
    path: Path, *, least_columns: int, unit_s: float | None = None
) -> tuple[list[tuple[float, list[str]]], str | None]:
    """Return the stamps of a text file in seconds, in increasing order, each with the words that follow it.

    Lines that begin with # are comments. Stamps are in units of `unit_s` seconds; if it is None, a unit of a
    millisecond or less is recognised by the size of the stamps, and returned as a doubt in a sentence. Raises
    DriveError that names the first invalid line.
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
    doubt = None
    middle = abs(rows[len(rows) // 2][0]) if rows else 0.0
    if unit_s is None and middle >= _SECONDS_BELOW:
        name, unit_s = next((each for each in _UNITS if middle * each[1] < _SECONDS_BELOW), _UNITS[-1])
        doubt = f"The stamps of {path.name} are too large for seconds ({middle:.0f}), and were read as {name}."
    return rows if unit_s is None else [(stamp * unit_s, words) for stamp, words in rows], doubt


def natural_order(name: str) -> list[int | str]:
    """Return the key that sorts names in natural order: 2 before 10."""
    return [int(part) if part.isdigit() else part for part in re.split(r"([0-9]+)", name)]


def period_s(stamps: ArrayLike) -> float | None:
    """Return the usual time in seconds between two of N increasing stamps; None if there are too few."""
    steps = np.diff(np.asarray(stamps, np.float64))
    steps = steps[steps > 0]
    return float(np.median(steps)) if len(steps) else None


def rate_hz(stamps: ArrayLike) -> float | None:
    """Return the usual number of stamps per second, for N increasing stamps; None if there are too few."""
    period = period_s(stamps)
    return None if period is None else 1 / period


def apart_in_time(
    images: Sequence[float],
    stamps: Sequence[float] | NDArray[np.float64],
    name: str,
    *,
    unit: str = "seconds",
    slack_s: float = 0.0,
) -> Iterator[str]:
    """Yield a doubt if the stamps of the list `name` have no moment in common with those of the images, both in
    increasing order."""
    if len(stamps) and (stamps[-1] < images[0] - slack_s or stamps[0] > images[-1] + slack_s):
        yield (
            f"The images are from {images[0]:.3f} to {images[-1]:.3f} s, {name} from {stamps[0]:.3f} to "
            f"{stamps[-1]:.3f} s, with no moment in common. Write both in {unit} of one clock."
        )


def nearest(stamps: Sequence[float], others: Sequence[float], *, slack_s: float) -> list[int | None]:
    """Return the index of the nearest of `others` for each stamp; None if the nearest is more than half a frame away.

    Both lists are in increasing order. Half a frame is half of the usual time between two stamps, and at least
    `slack_s`.
    """
    if not len(others):
        return [None] * len(stamps)
    wanted = np.asarray(stamps, np.float64)
    offered = np.asarray(others, np.float64)
    after = np.clip(np.searchsorted(offered, wanted), 1, max(len(offered) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(offered) - 1)
    place = np.where(np.abs(offered[before] - wanted) <= np.abs(offered[after] - wanted), before, after)
    within = np.abs(offered[place] - wanted) <= max((period_s(wanted) or 0.0) / 2, slack_s)
    return [int(k) if ok else None for k, ok in zip(place, within, strict=True)]


class OdometryTable:
    """A table of odometry."""

    def __init__(self, name: str, keys: Sequence[str], poses: Pose) -> None:
        """Take N keys (file names or stamps) and poses (N, 3); a row whose pose is not finite has no pose."""
        self.name = name
        self._poses = poses
        self._is_finite = np.asarray(np.isfinite(poses).all(axis=1))
        self._stamps = _numbers(keys)
        self._slack_s = _LEAST_SLACK_S
        if self._stamps is not None:
            self._slack_s = max((period_s(np.sort(self._stamps)) or 0.0) / 2, _LEAST_SLACK_S)
        self._places = {Path(key).name: place for place, key in enumerate(keys)}
        self._stems = {Path(key).stem: place for place, key in enumerate(keys)}

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self._poses)

    @classmethod
    def read(cls, path: Path) -> "OdometryTable":
        """Read a CSV file. Raises DriveError that names the first invalid line."""
        try:
            lines = csv.reader(io.StringIO(_read_list(path, "table of odometry"), newline=""))
            rows = [row for row in lines if row and not row[0].startswith("#")]
        except csv.Error as error:
            raise DriveError(f"{path} cannot be read as a table ({error!s:.120}); {_TABLE_NEEDS}.") from error
        order = list(range(_TABLE_COLUMNS))
        if rows and _numbers(rows[0][1:_TABLE_COLUMNS]) is None:
            order = _columns([name.strip().lower() for name in rows.pop(0)], path)
        keys: list[str] = []
        poses: list[list[float]] = []
        for number, row in enumerate(rows, start=1):
            try:
                keys.append(row[order[0]].strip())
                poses.append([float(row[column]) for column in order[1:]])
            except (IndexError, ValueError) as error:
                raise DriveError(f"{path}, row {number} is {','.join(row)!s:.60}; {_TABLE_NEEDS}.") from error
        if not poses:
            raise DriveError(f"{path} holds no rows; {_TABLE_NEEDS}.")
        return cls(path.name, keys, np.array(poses))

    @property
    def doubts(self) -> list[str]:
        """Return the doubts about the table: rows without a pose, and stamps out of order."""
        found = []
        if not self._is_finite.all():
            row = int(np.argmin(self._is_finite))
            pose = ", ".join(f"{number:g}" for number in self._poses[row])
            found.append(
                f"In {self.name}, {np.sum(~self._is_finite)} of {len(self)} rows have a pose that is not finite, "
                f"such as row {row + 1} ({pose}), so images of that time have no odometry. Delete these rows, or "
                "write the poses of the rows around them."
            )
        if self._stamps is not None and len(falls := np.flatnonzero(np.diff(self._stamps) < 0)):
            row = int(falls[0]) + 1
            found.append(
                f"The stamps of {self.name} do not increase: row {row + 1} has {self._stamps[row]:g} after "
                f"{self._stamps[row - 1]:g}. The nearest row was used for each image. If the rows are in the order of "
                "the images, correct the stamps."
            )
        return found

    def stamps_by_place(self, images: int) -> list[float] | None:
        """Return the stamps of all rows if their number is `images` and they increase; otherwise None."""
        if self._stamps is None or len(self._poses) != images or not (np.diff(self._stamps) > 0).all():
            return None
        return self._stamps.tolist()

    def pose(self, file: str, stamp: float) -> Pose | None:
        """Return the pose (3,) of a picture by its file name, or otherwise by its stamp; None if no row fits."""
        row = self._places.get(file, self._stems.get(Path(file).stem))
        if row is None and self._stamps is not None:
            nearest_row = int(np.argmin(np.abs(self._stamps - stamp)))
            row = nearest_row if abs(self._stamps[nearest_row] - stamp) <= self._slack_s else None
        return None if row is None or not self._is_finite[row] else self._poses[row]


def _columns(names: list[str], path: Path) -> list[int]:
    try:
        key = next(names.index(name) for name in _KEYS if name in names)
        return [key, *(names.index(name) for name in ("x", "y", "yaw"))]
    except (StopIteration, ValueError) as error:
        raise DriveError(f"{path} has the columns {', '.join(names)!s:.80}; {_TABLE_NEEDS}.") from error


def _numbers(texts: Sequence[str]) -> np.ndarray | None:
    try:
        numbers = np.array([float(text) for text in texts])
    except ValueError:
        return None
    return numbers if np.isfinite(numbers).all() else None
