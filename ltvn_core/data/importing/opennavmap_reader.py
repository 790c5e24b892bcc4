"""Reads the maps of OpenNavMap: lists of images with a time, a pose and a lens for each.

`poses.txt` holds world-to-camera poses of the optical frame, with w first in the quaternion; `timestamps.txt` holds
seconds, and `intrinsics.txt` fx fy cx cy width height. A depth image is beside each image, as `*.depth.png` in
millimetres. The edges of the map are not read, because the map is rebuilt.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from ltvn_core.data.importing.file_drive import FileDrive, FolderFormat, ListedFrame
from ltvn_core.data.importing.file_lens import FileLens
from ltvn_core.data.importing.pose_track import PoseTrack
from ltvn_core.data.importing.raw_frame import FrameMoment, ReadOptions, SourceFact
from ltvn_core.data.importing.stamped_lists import list_lines, rate_hz
from ltvn_core.errors import DriveError

POSES = "poses.txt"
STAMPS = "timestamps.txt"
LENSES = "intrinsics.txt"

_UNIT_TOLERANCE = 0.1


def _listed_drive(folder: Path, options: ReadOptions) -> FileDrive:
    """Read the lists, but no image. Raises DriveError."""
    listed = {name: numbers[0] for name, numbers in _rows(folder / STAMPS, columns=1).items()}
    stamps = dict(sorted(listed.items(), key=lambda item: item[1]))
    lenses = {
        name: FileLens(source=LENSES, fx=fx, fy=fy, cx=cx, cy=cy, size=(int(width), int(height)))
        for name, (fx, fy, cx, cy, width, height) in (
            _rows(folder / LENSES, columns=6) if (folder / LENSES).is_file() else {}
        ).items()
    }
    track = _track(folder / POSES, stamps)
    rate = rate_hz(list(stamps.values()))
    return FileDrive(
        format="opennavmap",
        folder=folder,
        frames=[
            ListedFrame(
                colour=name,
                moment=FrameMoment.with_truth(stamp, track.at(stamp)),
                depth=_depth_beside(folder, name),
                lens=lenses[name].camera if name in lenses else None,
            )
            for name, stamp in stamps.items()
        ],
        streams=(SourceFact("rgb", STAMPS, len(stamps), rate), SourceFact("truth", POSES, len(track.stamps), rate)),
    )


OPENNAVMAP = FolderFormat(lambda path: all((path / name).is_file() for name in (POSES, STAMPS, LENSES)), _listed_drive)
"""Maps of OpenNavMap, read as the drive from which they were made."""


def _depth_beside(folder: Path, name: str) -> str | None:
    beside = name.rpartition(".color.")[0] + ".depth.png"
    return beside if ".color." in name and (folder / beside).is_file() else None


def _rows(path: Path, *, columns: int) -> Mapping[str, list[float]]:
    """Return the numbers of each image. Raises DriveError that names the first invalid line."""
    found: dict[str, list[float]] = {}
    for number, line, words in list_lines(path, "list of images"):
        try:
            numbers = [float(word) for word in words[1 : columns + 1]]
        except ValueError:
            numbers = []
        if len(numbers) < columns or not np.isfinite(numbers).all():
            raise DriveError(f"{path}, line {number}: expected an image and {columns} numbers, got {line!s:.60}.")
        found[words[0]] = numbers
    if not found:
        raise DriveError(f"{path} lists no images; it needs lines of an image and {columns} numbers.")
    return found


def _track(path: Path, stamps: Mapping[str, float]) -> PoseTrack:
    """Return the poses of the images that have a stamp, converted from world-to-camera to camera-to-world."""
    rows = _rows(path, columns=7)
    poses = {stamps[name]: numbers for name, numbers in rows.items() if name in stamps}
    if not poses:
        raise DriveError(
            f"{path} and {STAMPS} name no image in common: {next(iter(rows))!s:.60} and others there, "
            f"{next(iter(stamps))!s:.60} and others here. Write the same names into both."
        )
    order = np.array(sorted(poses))
    numbers = np.array([poses[stamp] for stamp in order.tolist()])
    norms = np.linalg.norm(numbers[:, :4], axis=1)
    if (np.abs(norms - 1) > _UNIT_TOLERANCE).any():
        raise DriveError(f"{path}: a quaternion is not of length 1; the columns are image qw qx qy qz tx ty tz.")
    to_world = Rotation.from_quat(numbers[:, [1, 2, 3, 0]]).inv()
    return PoseTrack(order, -to_world.apply(numbers[:, 4:]), to_world)
