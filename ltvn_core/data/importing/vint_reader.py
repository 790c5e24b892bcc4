"""Reads trajectories in the training format of GNM, ViNT and NoMaD: `0.jpg`, `1.jpg`, ... and `traj_data.pkl`.

The pickle holds `position` (T, 2) in metres and `yaw` (T,) in radians; row k belongs to image k. There is no depth and
no stamp; the lens comes from a `camera.json`, if there is one.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ltvn_core.data.importing.file_drive import FileDrive, FolderFormat, ListedFrame
from ltvn_core.data.importing.foreign_files import require_within
from ltvn_core.data.importing.raw_frame import FrameMoment, ReadOptions, SourceFact
from ltvn_core.data.importing.restricted_pickle import load_pickle
from ltvn_core.data.importing.source_camera import camera_beside
from ltvn_core.errors import DriveError
from ltvn_core.types import Pose

TRAJECTORY = "traj_data.pkl"
DEFAULT_RATE_HZ = 4.0
"""Sampling rate of GNM's data sets."""

_SUFFIXES = (".jpg", ".jpeg", ".png")
_LARGEST_M = 1e5
_LISTED = 10
_LONGEST_ROW = 16
"""Largest number of values of one pose."""
_NUMBERS = (int, float, np.number)


def _listed_drive(folder: Path, options: ReadOptions) -> FileDrive:
    """Read the poses and list the images. Raises DriveError; for a whole data set, it lists the trajectories."""
    if not (folder / TRAJECTORY).is_file() and (several := _trajectories(folder)):
        names = ", ".join(several[:_LISTED]) + (" ..." if len(several) > _LISTED else "")
        raise DriveError(f"{folder} holds {len(several)} trajectories; name one of them: {names}.")
    rate = options.rate_hz or DEFAULT_RATE_HZ
    poses = _poses(folder)
    images = _images(folder)
    assumed = f"The images have no stamps; {DEFAULT_RATE_HZ:g} per second are assumed; --rate sets another rate."
    return FileDrive(
        format="vint",
        folder=folder,
        frames=[
            ListedFrame(colour=name, moment=FrameMoment(number / rate, poses[number] if number < len(poses) else None))
            for number, name in images.items()
        ],
        streams=(
            SourceFact("rgb", "*.jpg", len(images), rate),
            SourceFact("odometry", TRAJECTORY, len(poses), rate),
        ),
        camera=camera_beside(folder).camera,
        doubts=[] if options.rate_hz is not None else [assumed],
    )


VINT = FolderFormat(lambda path: (path / TRAJECTORY).is_file() or bool(_trajectories(path)), _listed_drive)
"""Trajectories, or folders of them."""


def _trajectories(path: Path) -> list[str]:
    if not path.is_dir():
        return []
    return sorted(each.name for each in path.iterdir() if (each / TRAJECTORY).is_file())


def _poses(folder: Path) -> Pose:
    """Return the poses (T, 3). Raises DriveError where the pickle holds none."""
    path = folder / TRAJECTORY
    if not path.is_file():
        raise DriveError(f"{folder} has no {TRAJECTORY}, which holds position (T, 2) and yaw (T,).")
    require_within(path, folder)
    held = load_pickle(path)
    if not isinstance(held, Mapping) or not {"position", "yaw"} <= held.keys():
        raise DriveError(f"{path} holds no trajectory: expected a mapping with position (T, 2) and yaw (T,).")
    position = _numbers(held["position"])
    yaw = _numbers(held["yaw"])
    if position.ndim != 2 or position.shape[1] < 2 or len(position) != yaw.size or not len(position):
        raise DriveError(f"{path}: position of shape {position.shape} and yaw of {yaw.shape} are no (T, 2) and (T,).")
    poses = np.column_stack([position[:, :2], yaw.reshape(-1)])
    if not np.isfinite(poses).all() or np.abs(poses[:, :2]).max() > _LARGEST_M:
        raise DriveError(f"{path}: poses must be finite, in metres and radians.")
    return poses


def _numbers(held: object) -> np.ndarray:
    if isinstance(held, list | tuple):
        # Lists may contain each other, and so expand to far more numbers than the file has bytes.
        array = np.asarray(held) if all(map(_is_short_row, held)) else np.empty(0)
    else:
        array = held if isinstance(held, np.ndarray) else np.empty(0)
    if array.dtype.kind == "O":
        array = _plain(array)
    return array.astype(np.float64) if array.dtype.kind in "fiu" else np.empty(0)


def _plain(objects: np.ndarray) -> np.ndarray:
    """Convert an array of objects to numbers: rows with n > 1 numbers add an axis; rows with one number become that
    number."""
    rows = objects.ravel().tolist()
    if not rows or not all(map(_is_short_row, rows)):
        return np.empty(0)
    flat = [np.asarray(row).ravel() for row in rows]
    if len({row.size for row in flat}) != 1:
        return np.empty(0)
    shape = objects.shape if flat[0].size == 1 else (*objects.shape, flat[0].size)
    return np.stack(flat).reshape(shape)


def _is_short_row(row: object) -> bool:
    """Tell whether an object is a number or a short list of numbers."""
    if isinstance(row, np.ndarray):
        return row.size <= _LONGEST_ROW and row.dtype.kind in "fiu"
    if isinstance(row, list | tuple):
        return len(row) <= _LONGEST_ROW and all(isinstance(each, _NUMBERS) for each in row)
    return isinstance(row, _NUMBERS)


def _images(folder: Path) -> dict[int, str]:
    """Return the images by their numbers, in increasing order. Raises DriveError if there are none."""
    found: dict[int, str] = {}
    for path in folder.iterdir():
        if path.suffix.lower() in _SUFFIXES and path.stem.isdecimal() and len(path.stem) < 10:
            found.setdefault(int(path.stem), path.name)
    if not found:
        raise DriveError(f"{folder} has no images; expected 0.jpg, 1.jpg and so on beside {TRAJECTORY}.")
    return dict(sorted(found.items()))
