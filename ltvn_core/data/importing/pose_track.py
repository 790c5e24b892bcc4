"""A trajectory in space in the formats of other programs, turned so that z is up.

Owns two formats, and the detection of the world's up axis. The first has `stamp tx ty tz qx qy qz qw` in each line (the
TUM format, which evo, ORB-SLAM and RTAB-Map write too). The second has a camera-to-world matrix for each picture:
7-Scenes writes `frame-000000.pose.txt` beside `frame-000000.color.png`, ScanNet `pose/0.txt` for `color/0.jpg`, each
with a 4 x 4 matrix; Replica writes `traj.txt` with 16 numbers in a row, row k for picture k.
"""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ltvn_core.data.importing.spatial_pose import SpatialPose, are_rotations, pose_between, spatial_pose
from ltvn_core.data.importing.stamped_lists import list_lines, period_s, stamped_lines
from ltvn_core.errors import DriveError

LARGEST_GAP_S = (0.25, 1.0)
"""Largest gap between samples in which poses are interpolated, in seconds: twice the usual gap, but within these
limits."""
_COLUMNS = 8
_UPRIGHT = 0.25
"""Least mean cosine between z and the camera's up direction for z to count as up (75 degrees); cameras may look down
steeply."""
_CLEARLY_UP = 0.8
"""Least mean cosine between an axis and the camera's up direction for the axis to count as up."""
_UNIT_TOLERANCE = 0.1
_BESIDE_S = 0.025
"""Largest time difference in seconds to a single sample, where there are no samples on both sides."""
_AXES = {"z": (0, 0, 1), "-y": (0, -1, 0), "y": (0, 1, 0), "-z": (0, 0, -1)}
"""Possible up axes: z in robotics, -y if the first camera defines the world, y in computer graphics."""
POSE_FOLDERS = ("pose", "poses")
ROWS_FILE = "traj.txt"
_NUMBERS = 16
_MOST_M = 1e6
_RIGID_TOLERANCE = 0.01
_FIRST_NUMBER = re.compile(r"[0-9]+")


class StampedPoses(NamedTuple):
    """Poses of one file."""

    stamps: NDArray[np.float64]
    """Times (N,) in seconds, increasing."""
    positions: NDArray[np.float64]
    """Positions (N, 3) in metres."""
    rotations: Rotation
    """N rotations, from the body or camera frame to the world."""
    doubt: str | None
    """Doubts about the stamps, in sentences; None if there are none."""


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
        """Take N increasing stamps, positions (N, 3) in metres, and N rotations from the optical frame to the world.

        `up_axis` is "z" if the source says so; if it is None, the up axis is detected.
        """
        self.stamps = stamps
        self.doubt = doubt
        """Doubts about the stamps, in sentences; None if there are none."""
        self.up_axis = up_axis or _up_axis(rotations)
        """Up axis of the source's world; positions and rotations are converted so that z is up."""
        turn = Rotation.align_vectors([[0, 0, 1]], [_AXES[self.up_axis]])[0] if self.up_axis != "z" else None
        self._positions = positions if turn is None else turn.apply(positions)
        self._rotations = rotations if turn is None else turn * rotations
        least_s, most_s = LARGEST_GAP_S
        self._largest_gap_s = min(max(least_s, 2 * (period_s(stamps) or 0.0)), most_s)

    @classmethod
    def read(cls, path: Path) -> "PoseTrack":
        """Read a file. Raises DriveError with the first invalid line."""
        return cls(*read_poses(path))

    def at(self, stamp: float) -> SpatialPose | None:
        """Return the pose at a time, interpolated between samples; None if there is no sample nearby."""
        after = int(np.searchsorted(self.stamps, stamp))
        around = slice(after - 1, after + 1)
        is_exact = after < len(self.stamps) and self.stamps[after] == stamp
        if is_exact or not 0 < after < len(self.stamps) or np.ptp(self.stamps[around]) > self._largest_gap_s:
            place = after if is_exact else int(np.argmin(np.abs(self.stamps - stamp)))
            if not abs(self.stamps[place] - stamp) <= _BESIDE_S:
                return None
            return spatial_pose(self._positions[place], self._rotations[place].as_matrix())
        before_s, after_s = self.stamps[around]
        share = (stamp - before_s) / (after_s - before_s)
        pose = pose_between(self._positions[around], self._rotations[around], share)
        return spatial_pose(pose[:3, 3], pose[:3, :3])


def read_poses(path: Path, *, scalar_first: bool = False, unit_s: float | None = None) -> StampedPoses:
    """Read lines of a stamp, a position and a quaternion; of several lines with the same stamp, the first counts.

    Args:
        path: The file, as `stamped_lines` reads it; further columns are ignored.
        scalar_first: Whether w is the first column of the quaternion; otherwise it is the last.
        unit_s: Unit of the stamps in seconds; None detects it by their size.

    Raises:
        DriveError: The file holds no poses, or an invalid pose, which the message names.
    """
    columns = f"stamp tx ty tz {'qw qx qy qz' if scalar_first else 'qx qy qz qw'}"
    lines, doubt = stamped_lines(path, least_columns=_COLUMNS, unit_s=unit_s)
    if not lines:
        raise DriveError(f"{path} holds no poses; it needs lines of {columns}.")
    try:
        numbers = np.array([[stamp, *map(float, words[: _COLUMNS - 1])] for stamp, words in lines])
    except ValueError as error:
        raise DriveError(f"{path}: a pose is not a row of numbers ({error!s:.80}).") from error
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
    """Return the up axis of the world, for a camera that is upright most of the time."""
    up = rotations.apply([0.0, -1.0, 0.0]).mean(axis=0)
    length = np.linalg.norm(up)
    if length == 0 or up[2] / length >= _UPRIGHT:
        return "z"
    best = max(_AXES, key=lambda name: float(up @ _AXES[name]))
    return best if float(up @ _AXES[best]) / length >= _CLEARLY_UP else "z"


class PicturePoses:
    """Poses of pictures by their index in the drive; z is up, whatever the up axis of the source's world is."""

    def __init__(self, matrices: NDArray[np.float64], name: str, *, up_axis: str | None = None) -> None:
        """Take camera-to-world matrices (N, 4, 4), one for each picture; a matrix with an invalid rotation counts as
        missing. `up_axis` is as in `PoseTrack`."""
        self.name = name
        """Name of the file or folder with the poses."""
        known = np.asarray((np.isfinite(matrices) & (np.abs(matrices) < _MOST_M)).all(axis=(1, 2)))
        turns = np.zeros((len(matrices), 3, 3))
        turns[known] = matrices[known, :3, :3]
        known &= are_rotations(turns, _RIGID_TOLERANCE)
        self.missing = int(len(known) - known.sum())
        """Number of pictures without a pose."""
        places = np.flatnonzero(known)
        good = matrices[known]
        self._places = set(places.tolist())
        self._track = None
        if len(good):
            rotations = Rotation.from_matrix(good[:, :3, :3])
            self._track = PoseTrack(places.astype(np.float64), good[:, :3, 3], rotations, up_axis=up_axis)

    def at(self, place: int) -> SpatialPose | None:
        """Return the pose of a picture by its index; None if it has none."""
        return self._track.at(place) if self._track is not None and place in self._places else None

    def __len__(self) -> int:
        """Return the number of pictures with a pose."""
        return len(self._places)


def picture_poses(
    matrices: Sequence[NDArray[np.float64] | None], name: str, *, up_axis: str | None = None
) -> PicturePoses | None:
    """Return the poses of pictures from a matrix (4, 4) or None for each; None if no picture has one."""
    if all(matrix is None for matrix in matrices):
        return None
    no_pose = np.full((4, 4), np.nan)
    known = np.array([no_pose if matrix is None else matrix for matrix in matrices])
    return PicturePoses(known, name, up_axis=up_axis)


def poses_beside(folder: Path, pictures: Sequence[Path]) -> PicturePoses | None:
    """Return the poses stored beside a folder's pictures; None if there are none. Raises DriveError."""
    rows = folder / ROWS_FILE
    if rows.is_file():
        return PicturePoses(_rows(rows, len(pictures)), ROWS_FILE)
    beside = pictures[0].parent
    where = "*.pose.txt"
    listed = list(beside.glob("*.pose.txt"))
    for name in POSE_FOLDERS:
        if not listed:
            where = name
            listed = list((folder / name).glob("*.txt"))
    by_number = {_number(path): path for path in listed if path.is_file()}
    if not any(_number(picture) in by_number for picture in pictures):
        return None
    no_pose = [np.nan] * _NUMBERS
    held = [_numbers(path) if (path := by_number.get(_number(picture))) else no_pose for picture in pictures]
    # A file without a matrix counts as no pose.
    matrices = [numbers if len(numbers) == _NUMBERS else no_pose for numbers in held]
    return PicturePoses(np.array(matrices).reshape(-1, 4, 4), where)


def _number(path: Path) -> int | None:
    found = _FIRST_NUMBER.search(path.name)
    return None if found is None else int(found.group()[:18])


def _rows(path: Path, count: int) -> NDArray[np.float64]:
    numbers = _numbers(path)
    if not numbers or len(numbers) % _NUMBERS or len(numbers) // _NUMBERS != count:
        raise DriveError(
            f"{path} holds {len(numbers)} numbers, which are not 16 for each of the {count} images (a 4 x 4 matrix, "
            "camera to world, row by row). Complete the file, or move it away to import the images without poses."
        )
    return np.array(numbers).reshape(count, 4, 4)


def _numbers(path: Path) -> list[float]:
    try:
        return [float(word) for _, _, words in list_lines(path, "list of poses") for word in words]
    except ValueError as error:
        raise DriveError(
            f"{path} cannot be read as poses ({error!s:.80}); it needs 4 x 4 numbers, camera to world."
        ) from error
