"""Reads the folders that the app Stray Scanner exports from phones with LiDAR.

`odometry.csv` has a row for each image: `timestamp, frame, x, y, z, qx, qy, qz, qw`, and from newer versions the lens
`fx, fy, cx, cy`. The world's y axis is up, and the quaternion is that of the optical frame (x right, y down, z
forward). The colours are `rgb.mp4`, or pictures that were taken out of it, with the frame's number in the name.
`depth/` is in millimetres, `confidence/` has the levels 0 to 2, `camera_matrix.csv` the lens.
"""

import re
from collections.abc import Mapping
from pathlib import Path

from ltvn_core.data.importing.file_drive import FileDrive, FileDriveReader, ListedFrame
from ltvn_core.data.importing.file_lens import FileLens, lens_beside
from ltvn_core.data.importing.folder_reader import colour_pictures, most_pictures
from ltvn_core.data.importing.spatial_pose import transform
from ltvn_core.data.importing.stamped_lists import list_lines
from ltvn_core.errors import DriveError

POSES = "odometry.csv"
VIDEO = "rgb.mp4"
_HEADER = re.compile(rb"\s*timestamp\s*,\s*frame\s*,\s*x\s*,\s*y\s*,\s*z\s*,\s*qx\s*,\s*qy\s*,\s*qz\s*,\s*qw")
_COLUMNS = ("timestamp", "frame", "x", "y", "z", "qx", "qy", "qz", "qw")
_MOST_FRAMES = 10_000_000
_LENS_COLUMNS = ("fx", "fy", "cx", "cy")


class StrayReader(FileDriveReader):
    """A scan of Stray Scanner, open for reading."""

    FORMAT = "stray"

    @classmethod
    def recognises(cls, path: Path) -> bool:
        """Tell whether a path is a folder with the app's table and its images; never raises."""
        try:
            with (path / POSES).open("rb") as file:
                is_table = _HEADER.match(file.read(200)) is not None
            return is_table and ((path / VIDEO).is_file() or most_pictures(path) > 0)
        except OSError:
            return False

    def _listed(self) -> FileDrive:
        folder = self._folder
        is_video = (folder / VIDEO).is_file()
        taken_out = {} if is_video else {_number(path): path for path in colour_pictures(folder, None).colours}
        matrix = lens_beside(folder)
        frames = [
            self._row(row, VIDEO if is_video else str(taken_out[int(row["frame"])].relative_to(folder)), matrix)
            for row in _rows(folder / POSES)
            if is_video or int(row["frame"]) in taken_out
        ]
        return FileDrive(
            frames=frames,
            rgb=VIDEO if is_video else "pictures",
            video=folder / VIDEO if is_video else None,
            poses=POSES,
            pose_role="odometry",
            up_axis="y",
        )

    def _row(self, row: Mapping[str, float], colour: str, matrix: FileLens | None) -> ListedFrame:
        numbered = f"{int(row['frame']):06d}.png"
        depth, confidence = f"depth/{numbered}", f"confidence/{numbered}"
        own = None
        if all(name in row for name in _LENS_COLUMNS):
            fx, fy, cx, cy = (row[name] for name in _LENS_COLUMNS)
            own = FileLens(source=POSES, fx=fx, fy=fy, cx=cx, cy=cy)
        return ListedFrame(
            colour=colour,
            stamp=row["timestamp"],
            depth=depth if (self._folder / depth).is_file() else None,
            confidence=confidence if (self._folder / confidence).is_file() else None,
            pose=transform([row[name] for name in "xyz"], [row[name] for name in ("qx", "qy", "qz", "qw")]),
            lens=own or matrix,
        )


def _number(path: Path) -> int:
    return int((re.findall(r"[0-9]+", path.stem) or ["-1"])[-1][:9])


def _rows(path: Path) -> list[dict[str, float]]:
    """Return the rows of the app's table by its columns. Raises DriveError that names the first invalid line."""
    lines = list_lines(path, "list of poses")
    _, _, names = next(lines)
    rows: list[dict[str, float]] = []
    for number, line, words in lines:
        try:
            row = dict(zip(names, map(float, words), strict=False))
            if not 0 <= int(row["frame"]) < _MOST_FRAMES:
                raise ValueError("no number of a frame")
            rows.append({name: row[name] for name in (*_COLUMNS, *(each for each in _LENS_COLUMNS if each in row))})
        except (ValueError, KeyError, OverflowError) as error:
            raise DriveError(f"{path}, line {number} is {line!s:.60}; it needs {', '.join(_COLUMNS)}.") from error
    return rows
