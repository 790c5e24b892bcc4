"""The lens of a drive in the files of other programs: a camera matrix in text or JSON, a format's own list, EXIF.

Owns the names of such files beside images, and the check that a lens without an image size belongs to the images.
"""

import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.cameras.encoded_images import heif_exif, is_heif
from ltvn_core.data.importing.foreign_files import read_foreign
from ltvn_core.data.importing.source_camera import HOW_TO
from ltvn_core.data.importing.stamped_lists import list_lines
from ltvn_core.errors import CameraError, DriveError
from ltvn_core.structured_text import parse_json

MATRIX_FILES = (
    "camera_matrix.csv",
    "camera-intrinsics.txt",
    "camera_intrinsics.txt",
    "intrinsics.txt",
    "intrinsic.txt",
    "intrinsic_color.txt",
    "intrinsic/intrinsic_color.txt",
    "K.txt",
    "cam_K.txt",
    "intrinsic.json",
    "camera_intrinsic.json",
)
"""Names of files with a camera matrix, as Stray Scanner, 3DMatch, ScanNet and Open3D write them."""
_MOST_BYTES = 100_000
_FOCAL_35MM_TAG = 0xA405
_EXIF_FOLDER_TAG = 0x8769
_DIAGONAL_35MM = 43.267
_OFF_CENTRE = 0.2
"""Largest distance of the lens's centre from the image's middle, as a share of the side."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FileLens:
    """A lens as a file gives it, perhaps without the size of its images."""

    source: str
    """Name of the file in messages."""
    fx: float
    fy: float
    cx: float
    cy: float
    size: tuple[int, int] | None = None
    """Width and height of its images in pixels; None if the file does not say it."""
    distortion: tuple[float, ...] = ()
    fisheye: bool = False

    def camera(self, width: int, height: int) -> CameraModel:
        """Return the camera, of images of this size if the file says none. Raises DriveError if it is not a camera."""
        aside = max(abs(self.cx / width - 0.5), abs(self.cy / height - 0.5))
        if self.size is None and not aside < _OFF_CENTRE:  # NaN is nowhere.
            raise DriveError(
                f"{self.source} has the lens's centre at {self.cx:.0f}, {self.cy:.0f}, far from the middle of images "
                f"of {width} x {height}, so it belongs to another image size; {HOW_TO}."
            )
        wide, high = self.size or (width, height)
        try:
            return CameraModel(
                width=wide,
                height=high,
                fx=self.fx,
                fy=self.fy,
                cx=self.cx,
                cy=self.cy,
                distortion=self.distortion if any(self.distortion) or self.fisheye else (),
                fisheye=self.fisheye,
            )
        except CameraError as error:
            raise DriveError(f"{self.source} describes no camera ({error!s:.120}); {HOW_TO}.") from error


def lens_beside(folder: Path) -> FileLens | None:
    """Return the lens in a camera matrix beside images; None if there is none. Raises DriveError."""
    path = next((folder / name for name in MATRIX_FILES if (folder / name).is_file()), None)
    return None if path is None else read_lens(path)


def read_lens(path: Path) -> FileLens:
    """Read fx fy cx cy, a matrix of 3 x 3 or 4 x 4 numbers, or Open3D's JSON. Raises DriveError."""
    try:
        size = None
        if path.suffix.lower() == ".json":
            fields = parse_json(read_foreign(path, most_bytes=_MOST_BYTES, what="camera matrix"))
            numbers = [float(number) for number in fields["intrinsic_matrix"]]
            size = (int(fields["width"]), int(fields["height"]))
        else:
            numbers = [float(word) for _, _, words in list_lines(path, "camera matrix") for word in words]
        fx, fy, cx, cy = _of_matrix(numbers)
    except (OSError, ValueError, TypeError, KeyError, OverflowError) as error:
        raise DriveError(
            f"{path} describes no lens ({type(error).__name__}: {error!s:.120}); it needs fx fy cx cy, or a camera "
            "matrix of 3 x 3 numbers, in pixels. Correct it, or move it away and use --camera."
        ) from error
    return FileLens(source=path.name, fx=fx, fy=fy, cx=cx, cy=cy, size=size)


def _of_matrix(numbers: list[float]) -> tuple[float, float, float, float]:
    """Return fx, fy, cx, cy; a matrix may be written row by row or column by column."""
    if not np.isfinite(numbers).all() or len(numbers) not in (4, 9, 16):
        raise ValueError(f"{len(numbers)} numbers")
    if len(numbers) == 4:
        return numbers[0], numbers[1], numbers[2], numbers[3]
    side = 3 if len(numbers) == 9 else 4
    matrix = np.reshape(numbers, (side, side))
    matrix = matrix.T if matrix[2, 0] and not matrix[0, 2] else matrix
    return float(matrix[0, 0]), float(matrix[1, 1]), float(matrix[0, 2]), float(matrix[1, 2])


def exif_camera(blob: bytes, width: int, height: int) -> CameraModel | None:
    """Return the lens by the EXIF focal length (35 mm equivalent) of a picture; None if it has none."""
    try:
        if is_heif(blob):
            exif = heif_exif(blob)
        else:
            with Image.open(io.BytesIO(blob)) as image:
                exif = image.getexif()
        focal_mm = float(exif.get_ifd(_EXIF_FOLDER_TAG).get(_FOCAL_35MM_TAG, 0))
    except Exception:  # Untrusted EXIF data may raise anything.
        return None
    if not 5 <= focal_mm <= 1000:
        return None
    focal_px = focal_mm / _DIAGONAL_35MM * (width**2 + height**2) ** 0.5
    return CameraModel(width=width, height=height, fx=focal_px, fy=focal_px, cx=(width - 1) / 2, cy=(height - 1) / 2)
