"""Reads the folders that the app Stray Scanner exports from phones with LiDAR.

`odometry.csv` has a row for each image: `timestamp, frame, x, y, z, qx, qy, qz, qw`, and from newer versions the lens
`fx, fy, cx, cy`. The world's y axis is up, and the quaternion is that of the optical frame (x right, y down, z
forward). The colours are `rgb.mp4`, or pictures that were taken out of it, with the frame's number in the name.
`depth/` is in millimetres, `confidence/` has the levels 0 to 2, `camera_matrix.csv` the lens.
"""

import re
from pathlib import Path

from ltvn_core.data.importing.file_drive import FileDrive, FolderFormat, ListedFrame, listed_streams
from ltvn_core.data.importing.file_lens import FileLens, lens_beside
from ltvn_core.data.importing.folder_reader import colour_pictures, most_pictures
from ltvn_core.data.importing.pose_track import picture_poses
from ltvn_core.data.importing.raw_frame import FrameMoment, ReadOptions
from ltvn_core.data.importing.spatial_pose import transform
from ltvn_core.data.importing.stamped_lists import list_lines
from ltvn_core.errors import DriveError

POSES = "odometry.csv"
VIDEO = "rgb.mp4"
_HEADER = re.compile(rb"\s*timestamp\s*,\s*frame\s*,\s*x\s*,\s*y\s*,\s*z\s*,\s*qx\s*,\s*qy\s*,\s*qz\s*,\s*qw")
_QUATERNION = ("qx", "qy", "qz", "qw")
_COLUMNS = ("timestamp", "frame", "x", "y", "z", *_QUATERNION)
_MOST_FRAMES = 10_000_000
_LENS_COLUMNS = ("fx", "fy", "cx", "cy")


def _listed_drive(folder: Path, options: ReadOptions) -> FileDrive:
    """Read the table, but no image. Raises DriveError."""
    is_video = (folder / VIDEO).is_file()
    taken_out = {} if is_video else {_number(path): path for path in colour_pictures(folder, None).colours}
    matrix = lens_beside(folder)
    rows = [row for row in _rows(folder / POSES) if is_video or int(row["frame"]) in taken_out]
    frames: list[ListedFrame] = []
    for row in rows:
        numbered = f"{int(row['frame']):06d}.png"
        lens = matrix
        if "fx" in row:
            lens = FileLens(source=POSES, fx=row["fx"], fy=row["fy"], cx=row["cx"], cy=row["cy"])
        frames.append(
            ListedFrame(
                colour=VIDEO if is_video else str(taken_out[int(row["frame"])].relative_to(folder)),
                moment=FrameMoment(row["timestamp"]),
                depth=_existing(folder, f"depth/{numbered}"),
                confidence=_existing(folder, f"confidence/{numbered}"),
                lens=None if lens is None else lens.camera,
            )
        )
    poses = [transform([row[name] for name in "xyz"], [row[name] for name in _QUATERNION]) for row in rows]
    return FileDrive(
        format="stray",
        folder=folder,
        frames=frames,
        streams=listed_streams(frames, VIDEO if is_video else "pictures", options),
        poses=picture_poses(poses, POSES, up_axis="y"),
        pose_role="odometry",
        has_fixed_names=True,
        video=folder / VIDEO if is_video else None,
    )


def _is_scan(path: Path) -> bool:
    with (path / POSES).open("rb") as file:
        is_table = _HEADER.match(file.read(200)) is not None
    return is_table and ((path / VIDEO).is_file() or most_pictures(path) > 0)


STRAY = FolderFormat(_is_scan, _listed_drive)
"""Scans of Stray Scanner: folders with the app's table and its images."""


def _existing(folder: Path, name: str) -> str | None:
    return name if (folder / name).is_file() else None


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
            has_lens = all(name in row for name in _LENS_COLUMNS)
            rows.append({name: row[name] for name in (*_COLUMNS, *(_LENS_COLUMNS if has_lens else ()))})
        except (ValueError, KeyError, OverflowError) as error:
            raise DriveError(f"{path}, line {number} is {line!s:.60}; it needs {', '.join(_COLUMNS)}.") from error
    return rows
