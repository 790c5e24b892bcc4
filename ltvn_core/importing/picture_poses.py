"""Poses of a folder's pictures as matrices, camera to world: a file for each picture, or a row for each.

7-Scenes writes `frame-000000.pose.txt` beside `frame-000000.color.png`, ScanNet `pose/0.txt` for `color/0.jpg`, each
with a 4 x 4 matrix; Replica writes `traj.txt` with 16 numbers a row, row k for picture k.
"""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ltvn_core.errors import DriveError
from ltvn_core.importing.moving_frame import are_rotations
from ltvn_core.importing.pose_track import PoseTrack
from ltvn_core.importing.spatial_pose import SpatialPose
from ltvn_core.importing.text_lists import list_lines

POSE_FOLDERS = ("pose", "poses")
ROWS_FILE = "traj.txt"
_NUMBERS = 16
_MOST_M = 1e6
_RIGID_TOLERANCE = 0.01
_FIRST_NUMBER = re.compile(r"[0-9]+")


class PicturePoses:
    """Poses of pictures by their place in the drive; z is up, however the source's world is turned."""

    def __init__(self, matrices: NDArray[np.float64], name: str) -> None:
        """Take (N, 4, 4) camera to world, one for each picture; rows that are no pose hold no rotation."""
        self.name = name
        """The file or folder that they come from."""
        known = _are_rigid(matrices)
        self.missing = int(len(known) - known.sum())
        """Pictures without a pose."""
        places, good = np.flatnonzero(known), matrices[known]
        self._places = set(places.tolist())
        self._track = None
        if len(good):
            self._track = PoseTrack(places.astype(np.float64), good[:, :3, 3], Rotation.from_matrix(good[:, :3, :3]))

    def at(self, place: int) -> SpatialPose | None:
        """Return the pose of a picture by its place; None where it has none."""
        if self._track is None or place not in self._places:
            return None
        return self._track.at(place)

    def __len__(self) -> int:
        """Return how many pictures have a pose."""
        return len(self._places)


def poses_beside(folder: Path, pictures: Sequence[Path]) -> PicturePoses | None:
    """Return the poses that lie beside a folder's pictures; None where there are none. Raises DriveError."""
    rows = folder / ROWS_FILE
    if rows.is_file():
        return PicturePoses(_rows(rows, len(pictures)), ROWS_FILE)
    beside = pictures[0].parent
    where, listed = "*.pose.txt", list(beside.glob("*.pose.txt"))
    for name in POSE_FOLDERS:
        if not listed:
            where, listed = name, list((folder / name).glob("*.txt"))
    by_number = {_number(path): path for path in listed if path.is_file()}
    if not any(_number(picture) in by_number for picture in pictures):
        return None
    matrices = [_matrix(by_number.get(_number(picture))) for picture in pictures]
    return PicturePoses(np.array(matrices), where)


def _number(path: Path) -> int | None:
    found = _FIRST_NUMBER.search(path.name)
    return None if found is None else int(found.group()[:18])


def _matrix(path: Path | None) -> NDArray[np.float64]:
    """Return the matrix of a file, (4, 4); of NaN where the picture has no file or its file no matrix."""
    numbers = [] if path is None else _numbers(path)
    return np.array(numbers if len(numbers) == _NUMBERS else [np.nan] * _NUMBERS).reshape(4, 4)


def _rows(path: Path, count: int) -> NDArray[np.float64]:
    numbers = _numbers(path)
    if not numbers or len(numbers) % _NUMBERS or len(numbers) // _NUMBERS != count:
        raise DriveError(
            f"{path} holds {len(numbers)} numbers, which are not 16 for each of the {count} pictures (a 4 x 4 matrix, "
            "camera to world, row by row). Complete the file, or move it away to import the pictures without poses."
        )
    return np.array(numbers).reshape(count, 4, 4)


def _numbers(path: Path) -> list[float]:
    try:
        return [float(word) for _, _, words in list_lines(path, "list of poses") for word in words]
    except ValueError as error:
        raise DriveError(
            f"{path} cannot be read as poses ({error!s:.80}); it needs 4 x 4 numbers, camera to world."
        ) from error


def _are_rigid(matrices: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tell (N,) which of (N, 4, 4) are finite and turn without stretching."""
    finite = np.asarray((np.isfinite(matrices) & (np.abs(matrices) < _MOST_M)).all(axis=(1, 2)))
    turns = np.zeros((len(matrices), 3, 3))
    turns[finite] = matrices[finite, :3, :3]
    return finite & are_rotations(turns, _RIGID_TOLERANCE)
