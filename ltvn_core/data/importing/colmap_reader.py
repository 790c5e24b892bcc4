"""Reads the images and lenses of a COLMAP model in text form: `cameras.txt` and `images.txt`, in natural order.

The poses have a unit of their own, which COLMAP cannot know, so they are not used as odometry.
"""

from collections.abc import Mapping
from pathlib import Path

from ltvn_core.data.importing.file_drive import FileDrive, FolderFormat, ListedFrame, listed_streams
from ltvn_core.data.importing.file_lens import FileLens
from ltvn_core.data.importing.raw_frame import ReadOptions
from ltvn_core.data.importing.stamped_lists import list_lines, natural_order
from ltvn_core.errors import DriveError

_MODELS = ("", "sparse", "sparse/0", "sparse/txt")
_IMAGES = ("images", "")
_LISTS = ("cameras.txt", "images.txt")
_KINDS = {
    "SIMPLE_PINHOLE": "f cx cy",
    "PINHOLE": "fx fy cx cy",
    "SIMPLE_RADIAL": "f cx cy k1",
    "RADIAL": "f cx cy k1 k2",
    "OPENCV": "fx fy cx cy k1 k2 p1 p2",
    "FULL_OPENCV": "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6",
    "OPENCV_FISHEYE": "fx fy cx cy k1 k2 k3 k4",
}
"""Name of a camera model -> its parameters in order."""


def _listed_drive(folder: Path, options: ReadOptions) -> FileDrive:
    """Read both lists, but no image. Raises DriveError."""
    model = _model(folder) or folder
    lenses = _lenses(model / _LISTS[0])
    frames = [
        ListedFrame(colour=found, lens=lenses[camera].camera if camera in lenses else None)
        for name, camera in _images(model / _LISTS[1])
        for found in [f"{each}/{name}".lstrip("/") for each in _IMAGES if _is_file(folder / each / name)][:1]
    ]
    return FileDrive(
        format="colmap",
        folder=folder,
        frames=sorted(frames, key=lambda frame: natural_order(frame.colour)),
        streams=listed_streams(frames, _LISTS[1], options),
        has_fixed_names=True,
        doubts=[
            f"The poses in {_LISTS[1]} have a unit of COLMAP's own and are not in metres, so they were not used. "
            "Odometry in metres in a TUM list, or a model that was scaled and exported as transforms.json, is used."
        ],
    )


COLMAP = FolderFormat(lambda path: _model(path) is not None, _listed_drive)
"""Folders with images and a COLMAP model in text form."""


def _model(path: Path) -> Path | None:
    return next((path / each for each in _MODELS if all((path / each / name).is_file() for name in _LISTS)), None)


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):  # A name that is too long, or has a zero byte.
        return False


def _lenses(path: Path) -> Mapping[str, FileLens]:
    """Return the lens of each camera whose model is supported. Raises DriveError."""
    found: dict[str, FileLens] = {}
    for number, line, words in list_lines(path, "list of cameras"):
        kind = words[1] if len(words) > 1 else ""
        try:
            names = _KINDS.get(kind, "").split()
            said = dict(zip(names, map(float, words[4:]), strict=bool(names)))
            size = (int(words[2]), int(words[3]))
        except (ValueError, IndexError) as error:
            raise DriveError(f"{path}, line {number} is {line!s:.60}; it needs a camera of COLMAP.") from error
        if not said:
            continue
        order = (
            ("k1", "k2", "k3", "k4") if kind == "OPENCV_FISHEYE" else ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
        )
        count = 4 if kind != "FULL_OPENCV" else 8
        found[words[0]] = FileLens(
            source=path.name,
            fx=said.get("fx", said.get("f", 0.0)),
            fy=said.get("fy", said.get("f", 0.0)),
            cx=said["cx"] - 0.5,  # In COLMAP the centre of the first pixel is at 0.5.
            cy=said["cy"] - 0.5,
            size=size,
            distortion=tuple(said.get(name, 0.0) for name in order[:count]),
            fisheye=kind == "OPENCV_FISHEYE",
        )
    return found


def _images(path: Path) -> list[tuple[str, str]]:
    """Return name and camera of each image; between them are lines of points, which hold only numbers."""
    lines = (words for _, _, words in list_lines(path, "list of images"))
    return [(" ".join(words[9:]), words[8]) for words in lines if len(words) > 9 and not _is_number(words[-1])]


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
