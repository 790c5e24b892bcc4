"""The little of YAML that calibration files use: words and lists of numbers behind names, as OpenCV and EuRoC write it.

No library for YAML is needed for it, and none of YAML's references and tags, by which a small file can stand for a
large one, means anything here.
"""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ltvn_core.errors import DriveError
from ltvn_core.importing.foreign_files import read_foreign
from ltvn_core.importing.moving_frame import Transform, are_rotations

_MOST_BYTES = 100_000
_NAME = re.compile(r"^([A-Za-z_]\w*)[ \t]*:", re.MULTILINE)
_COMMENT = re.compile(r"(?:^|(?<=\s))#.*$", re.MULTILINE)
_RIGID_TOLERANCE = 0.02
"""Files round their numbers."""
_LIST = re.compile(r"\[([^\[\]]*)\]")


class CalibrationYaml:
    """What a file says, by the names that stand at the beginning of a line."""

    def __init__(self, path: Path) -> None:
        """Read a file. Raises DriveError where it is no text or too long."""
        self._path = path
        try:
            text = read_foreign(path, most_bytes=_MOST_BYTES, what="calibration").decode("utf-8-sig")
        except (OSError, UnicodeDecodeError) as error:
            raise DriveError(f"{path} cannot be read as text ({error!s:.120}).") from error
        parts = _NAME.split(_COMMENT.sub("", text))
        self._values = dict(zip(parts[1::2], parts[2::2], strict=True))

    def word(self, name: str) -> str:
        """Return what stands behind a name on its line, empty where the file has no such name."""
        return (self._values.get(name, "").strip().splitlines() or [""])[0].strip().strip("\"'")

    def numbers(self, name: str) -> Sequence[float]:
        """Return the list of a name, or its `data`; empty where the file has none. Raises DriveError."""
        found = _LIST.search(self._values.get(name, ""))
        try:
            numbers = [float(word) for word in found.group(1).split(",") if word.strip()] if found else []
        except ValueError as error:
            raise DriveError(f"{self._path}: {name} is no list of numbers ({error!s:.80}).") from error
        if not np.isfinite(numbers).all():
            raise DriveError(f"{self._path}: {name} holds numbers that are not finite.")
        return numbers

    def transform(self, name: str) -> Transform | None:
        """Return a pose in space from 3 or 4 rows of 4 numbers, None where there is none. Raises DriveError."""
        numbers = self.numbers(name)
        if not numbers:
            return None
        matrix = np.eye(4)
        if len(numbers) in (12, 16):
            matrix[:3] = np.reshape(numbers[:12], (3, 4))
        if len(numbers) not in (12, 16) or not is_rigid(matrix):
            raise DriveError(f"{self._path}: {name} is no pose; it needs 3 or 4 rows of 4 numbers, a rotation first.")
        return matrix


def is_rigid(matrix: Transform) -> bool:
    """Tell whether a matrix (4, 4) is finite, turns without mirroring or stretching, and ends in 0, 0, 0, 1."""
    if not np.isfinite(matrix).all():
        return False
    is_rotation = bool(are_rotations(matrix[:3, :3], _RIGID_TOLERANCE))
    return is_rotation and bool(np.abs(matrix[3] - [0, 0, 0, 1]).max() < _RIGID_TOLERANCE)
