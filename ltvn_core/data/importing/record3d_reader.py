"""Reads recordings of the app Record3D: a `.r3d` file, which is a ZIP archive, or the folder that was unpacked from it.

`metadata` is JSON with the lens (`K` column by column, `w`, `h`), `fps`, and poses (qx qy qz qw x y z) of the camera in
ARKit's axes, in a world whose y axis is up. `rgbd/N.jpg` are the colours. `rgbd/N.depth` is compressed by LZFSE, which
is not read; 16-bit PNGs in millimetres in `depth/` are.
"""

import zipfile
from pathlib import Path
from typing import Any

from ltvn_core.data.importing.file_drive import OPTICAL_FROM_GRAPHICS, FileDrive, FileDriveReader, ListedFrame
from ltvn_core.data.importing.file_lens import FileLens
from ltvn_core.data.importing.foreign_files import MOST_IMAGE_BYTES, read_bytes_within
from ltvn_core.data.importing.raw_frame import ReadOptions, SourceFact
from ltvn_core.data.importing.spatial_pose import transform
from ltvn_core.errors import DriveError
from ltvn_core.structured_text import parse_json

_LISTS = ("metadata", "metadata.json")
_COLOURS = ("rgbd/{}.jpg", "rgb/{}.jpg", "rgb/{}.png")
_DECODING = (
    "It is compressed by LZFSE: unpack the file, decode the depth (the Python package pyliblzfse does; floats in "
    "metres, dh rows of dw), and save it as depth/N.png in the folder, in 16 bits and millimetres."
)


class Record3dReader(FileDriveReader):
    """A recording of Record3D, open for reading."""

    FORMAT = "record3d"

    def __init__(self, path: Path, options: ReadOptions) -> None:
        """Read the metadata, but no image yet. Raises DriveError."""
        self._archive = None
        if path.is_file():
            try:
                self._archive = zipfile.ZipFile(path)
            except (OSError, zipfile.BadZipFile) as error:
                raise DriveError(f"{path} is no whole .r3d file ({error!s:.120}); copy it again.") from error
        super().__init__(path, options)

    @classmethod
    def recognises(cls, path: Path) -> bool:
        """Tell whether a path is a `.r3d` file, or the folder unpacked from it; never raises."""
        try:
            if path.suffix.lower() == ".r3d" and path.is_file():
                return True
            is_folder = (path / "rgbd").is_dir() or (path / "rgb").is_dir()
            return is_folder and any((path / name).is_file() and _is_metadata(path / name) for name in _LISTS)
        except OSError:
            return False

    def _bytes(self, name: str) -> bytes:
        if self._archive is None:
            return read_bytes_within(self._folder, name)
        try:
            if self._archive.getinfo(name).file_size > MOST_IMAGE_BYTES:
                raise DriveError(f"{name} in {self._folder} is too large for a file of a phone.")
            return self._archive.read(name)
        except (KeyError, OSError, RuntimeError, zipfile.BadZipFile, NotImplementedError) as error:
            raise DriveError(f"{name} cannot be read from {self._folder} ({error!s:.120}).") from error

    def _has(self, name: str) -> bool:
        return (self._folder / name).is_file() if self._archive is None else name in self._archive.NameToInfo

    def _listed(self) -> FileDrive:
        name = next((each for each in _LISTS if self._has(each)), _LISTS[0])
        try:
            said = parse_json(self._bytes(name))
            lenses = _lenses(said, name)
            stamps = said.get("frameTimestamps") or [place / float(said["fps"]) for place in range(len(said["poses"]))]
            frames = [
                ListedFrame(
                    colour=colour,
                    stamp=float(stamps[place]),
                    depth=f"depth/{place}.png" if self._has(f"depth/{place}.png") else None,
                    pose=None
                    if (pose := transform(numbers[4:7], numbers[:4])) is None
                    else pose @ OPTICAL_FROM_GRAPHICS,
                    lens=lenses[min(place, len(lenses) - 1)],
                )
                for place, numbers in enumerate(said["poses"])
                if (colour := next((each.format(place) for each in _COLOURS if self._has(each.format(place))), ""))
            ]
        except (ValueError, TypeError, KeyError, IndexError, AttributeError, ZeroDivisionError) as error:
            raise DriveError(
                f"{name} of {self._folder} is not of Record3D ({type(error).__name__}: {error!s:.120}); it needs K, w, "
                "h, fps and poses. Export the recording again."
            ) from error
        packed = SourceFact("", "rgbd/*.depth", could_be="depth", kind="LZFSE", remedy=_DECODING)
        return FileDrive(
            frames=frames,
            rgb=frames[0].colour.partition("/")[0] if frames else "",
            poses=name,
            pose_role="odometry",
            up_axis="y",
            unread=[packed] if self._has("rgbd/0.depth") else [],
        )


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
