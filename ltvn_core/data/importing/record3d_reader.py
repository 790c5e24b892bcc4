"""Reads recordings of the app Record3D: a `.r3d` file, which is a ZIP archive, or the folder that was unpacked from it.

`metadata` is JSON with the lens (`K` column by column, `w`, `h`), `fps`, and poses (qx qy qz qw x y z) of the camera in
ARKit's axes, in a world whose y axis is up. `rgbd/N.jpg` are the colours. `rgbd/N.depth` is compressed by LZFSE, which
is not read; 16-bit PNGs in millimetres in `depth/` are.
"""

import zipfile
from pathlib import Path
from typing import Any

from ltvn_core.data.importing.file_drive import (
    FileDrive,
    FolderFormat,
    ListedFrame,
    archived_bytes,
    listed_streams,
)
from ltvn_core.data.importing.file_lens import FileLens
from ltvn_core.data.importing.foreign_files import read_bytes_within
from ltvn_core.data.importing.pose_track import picture_poses
from ltvn_core.data.importing.raw_frame import FrameMoment, ReadOptions, SourceFact
from ltvn_core.data.importing.spatial_pose import OPTICAL_FROM_GRAPHICS, Transform, transform
from ltvn_core.errors import DriveError
from ltvn_core.structured_text import parse_json

_LISTS = ("metadata", "metadata.json")
_COLOURS = ("rgbd/{}.jpg", "rgb/{}.jpg", "rgb/{}.png")
_DECODING = (
    "It is compressed by LZFSE: unpack the file, decode the depth (the Python package pyliblzfse does; floats in "
    "metres, dh rows of dw), and save it as depth/N.png in the folder, in 16 bits and millimetres."
)


def _listed_drive(path: Path, options: ReadOptions) -> FileDrive:
    """Read the metadata, but no image. Raises DriveError."""
    try:
        archive = zipfile.ZipFile(path) if path.is_file() else None
    except (OSError, zipfile.BadZipFile) as error:
        raise DriveError(f"{path} is no whole .r3d file ({error!s:.120}); copy it again.") from error

    def has(name: str) -> bool:
        return (path / name).is_file() if archive is None else name in archive.NameToInfo

    name = next(filter(has, _LISTS), _LISTS[0])
    try:
        said = parse_json(read_bytes_within(path, name) if archive is None else archived_bytes(archive, name))
        lenses = _lenses(said, name)
        stamps = said.get("frameTimestamps") or [place / float(said["fps"]) for place in range(len(said["poses"]))]
        frames: list[ListedFrame] = []
        poses: list[Transform | None] = []
        for place, numbers in enumerate(said["poses"]):
            colour = next((each.format(place) for each in _COLOURS if has(each.format(place))), None)
            depth = f"depth/{place}.png"
            pose = transform(numbers[4:7], numbers[:4])
            if colour is None:
                continue
            frames.append(
                ListedFrame(
                    colour=colour,
                    moment=FrameMoment(float(stamps[place])),
                    depth=depth if has(depth) else None,
                    lens=lenses[min(place, len(lenses) - 1)].camera,
                )
            )
            poses.append(None if pose is None else pose @ OPTICAL_FROM_GRAPHICS)
    except (ValueError, TypeError, KeyError, IndexError, AttributeError, ZeroDivisionError) as error:
        raise DriveError(
            f"{name} of {path} is not of Record3D ({type(error).__name__}: {error!s:.120}); it needs K, w, h, fps and "
            "poses. Export the recording again."
        ) from error
    packed = SourceFact("", "rgbd/*.depth", could_be="depth", kind="LZFSE", remedy=_DECODING)
    return FileDrive(
        format="record3d",
        folder=path,
        frames=frames,
        streams=listed_streams(frames, frames[0].colour.partition("/")[0] if frames else "", options),
        unread=[packed] if has("rgbd/0.depth") else [],
        poses=picture_poses(poses, name, up_axis="y"),
        pose_role="odometry",
        has_fixed_names=True,
        archive=archive,
    )


def _is_recording(path: Path) -> bool:
    if path.suffix.lower() == ".r3d" and path.is_file():
        return True
    is_folder = (path / "rgbd").is_dir() or (path / "rgb").is_dir()
    return is_folder and any((path / name).is_file() and _is_metadata(path / name) for name in _LISTS)


RECORD3D = FolderFormat(_is_recording, _listed_drive)
"""Recordings of Record3D: `.r3d` files, or the folders unpacked from them."""


def _is_metadata(path: Path) -> bool:
    with path.open("rb") as file:
        begin = file.read(1_000_000)
    return begin.lstrip().startswith(b"{") and b'"poses"' in begin


def _lenses(said: Any, name: str) -> list[FileLens]:
    """Return the lens of each image, or the one of all."""
    size = (int(said["w"]), int(said["h"]))
    k = [float(number) for number in said["K"]]
    own = said.get("perFrameIntrinsicCoeffs") or [(k[0], k[4], k[6] or k[2], k[7] or k[5])]
    return [FileLens(source=name, fx=fx, fy=fy, cx=cx, cy=cy, size=size) for fx, fy, cx, cy in own]
