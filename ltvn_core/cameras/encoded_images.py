"""Decoding of compressed images from untrusted files: checks their size before decoding, and raises one clear error.

Images in HEIC, the format of many phones, are read if pillow_heif is installed. RTAB-Map and ROS compress depth by RVL
(A. Wilson, *Fast Lossless Depth Image Compression*, ISS 2017): runs of pixels without depth alternate with runs of
pixels with depth, and depth is stored as the difference from the previous pixel. Each number is a sequence of nibbles:
three bits of data, and one bit for whether another nibble follows.
"""

import io
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import cv2
import numpy as np
from cv2.utils import logging as cv2_logging
from numpy.typing import NDArray
from PIL import Image

from ltvn_core.errors import DriveError
from ltvn_core.extras import is_installed, missing_text
from ltvn_core.types import Depth, Rgb

_LIBRARY = "pillow_heif"
_BRANDS = (b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1")
_SHIFTS = np.arange(28, -4, -4)
"""Bit shifts of the eight nibbles in a word of 32 bits, the first in its highest bits."""
_LONGEST = 11
"""Largest number of nibbles that a 32-bit number needs."""
MAX_PIXELS = 64_000_000
"""Largest number of pixels of an image; no robot's camera has more, so a file with more is a decompression bomb."""
NO_RETURN = 65535
"""Value for missing depth in 16-bit images of some cameras, instead of 0."""
_FORMATS = ("JPEG", "PNG", "WEBP", "BMP", "PPM", "TIFF")


def is_heif(blob: bytes) -> bool:
    """Return whether the bytes begin like a HEIC image."""
    return blob[4:8] == b"ftyp" and blob[8:12] in _BRANDS


def heif_size(blob: bytes, source: str) -> tuple[int, int]:
    """Return width and height, without decoding. Raises DriveError like `heif_colours`."""
    width, height = _opened(blob, source).size
    return width, height


def heif_colours(blob: bytes, source: str) -> Rgb:
    """Return the colours (H, W, 3), upright. Raises DriveError for a damaged image, and if the library is missing."""
    opened = _opened(blob, source)
    try:
        return np.array(opened.to_pillow().convert("RGB"), np.uint8)
    except Exception as error:  # The library raises many kinds of errors for damaged images.
        raise DriveError(_damaged(blob, source)) from error


def heif_exif(blob: bytes) -> Image.Exif:
    """Return the EXIF data of an image; empty if it has none."""
    exif = Image.Exif()
    exif.load(_opened(blob, "the picture").info.get("exif") or b"")
    return exif


def _opened(blob: bytes, source: str) -> Any:
    if not is_installed(_LIBRARY):
        raise DriveError(f"{source} is in HEIC. {missing_text(_LIBRARY)} Or convert it to JPEG.")
    import pillow_heif

    try:
        return pillow_heif.open_heif(io.BytesIO(blob))
    except Exception as error:  # As above.
        raise DriveError(_damaged(blob, source)) from error


def decode_rvl(data: bytes, width: int, height: int, source: str) -> NDArray[np.uint16]:
    """Return depth (height, width) in the units of the compressed data. Raises DriveError if it is damaged."""
    pixels = width * height
    if not 0 < pixels <= MAX_PIXELS or len(data) < 4:
        raise DriveError(f"{source}: {len(data):,} bytes are not a depth image of {width} x {height}.")
    numbers = _numbers(data, source)
    places, steps = _runs(numbers, pixels, source)
    change = (steps >> 1) ^ -(steps & 1)
    image = np.zeros(pixels, np.uint16)
    image[places] = np.cumsum(change).astype(np.uint16)
    return image.reshape(height, width)


def _numbers(data: bytes, source: str) -> NDArray[np.int64]:
    """Return all numbers of the stream."""
    words = np.frombuffer(data[: len(data) // 4 * 4], "<u4")
    nibbles = ((words[:, None] >> _SHIFTS.astype(np.uint32)) & 0xF).ravel().astype(np.int64)
    ends = np.flatnonzero(nibbles < 8)
    begins = np.concatenate([[0], ends[:-1] + 1]) if len(ends) else ends
    if len(ends) == 0 or (ends - begins).max() >= _LONGEST:
        raise DriveError(f"{source}: the compressed depth is damaged.")
    place = np.arange(ends[-1] + 1) - np.repeat(begins, ends - begins + 1)
    return np.add.reduceat((nibbles[: ends[-1] + 1] & 7) << (3 * place), begins)


def _runs(numbers: NDArray[np.int64], pixels: int, source: str) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the indices (N,) of the pixels that have depth, and their encoded differences (N,)."""
    places = []
    steps = []
    read = 0
    pixel = 0
    while pixel < pixels:
        if read + 1 >= len(numbers):
            raise DriveError(f"{source}: the compressed depth ends after {pixel:,} of {pixels:,} pixels.")
        empty = int(numbers[read])
        full = int(numbers[read + 1])
        read = read + 2
        pixel = pixel + empty
        if empty + full == 0 or pixel + full > pixels or read + full > len(numbers):
            raise DriveError(f"{source}: the compressed depth is damaged.")
        places.append(np.arange(pixel, pixel + full))
        steps.append(numbers[read : read + full])
        read = read + full
        pixel = pixel + full
    return np.concatenate(places), np.concatenate(steps)


def encoded_size(blob: bytes, source: str) -> tuple[int, int]:
    """Return width and height of a compressed image without decoding it. Raises DriveError like `decode_colour`."""
    with _libraries_silent():
        return _check_container(blob, source)


def decode_colour(blob: bytes, source: str) -> Rgb:
    """Return the colours (H, W, 3) of a JPEG, PNG, HEIC or their like; one channel becomes grey.

    Args:
        blob: The compressed image.
        source: Name of the image in messages.

    Raises:
        DriveError: The image is damaged, truncated, of another format, or too large.
    """
    if is_heif(blob):
        if np.prod(heif_size(blob, source)) > MAX_PIXELS:
            raise _too_large(source)
        return heif_colours(blob, source)
    return np.asarray(_decoded(blob, cv2.IMREAD_COLOR_RGB, source), np.uint8)


def decode_depth(blob: bytes, metres_per_unit: float, source: str) -> Depth:
    """Return depth (H, W) in metres from a 16-bit PNG or a TIFF of floats; raises DriveError like `decode_colour`.

    A PNG with four channels contains the four bytes of a float in metres, as written by RTAB-Map.
    """
    units = _decoded(blob, cv2.IMREAD_UNCHANGED, source)
    if units.dtype == np.uint8 and units.ndim == 3 and units.shape[2] == 4:
        metres = np.ascontiguousarray(units).view("<f4")[..., 0]
        return np.where(np.isfinite(metres) & (metres > 0), metres, 0).astype(np.float32)
    if units.ndim != 2 or units.dtype not in (np.uint16, np.float32):
        raise DriveError(
            f"{source} is not a depth image: expected one channel of 16 bits, got shape {units.shape} of {units.dtype}."
        )
    if units.dtype == np.uint16:
        units = np.where(units == NO_RETURN, 0, units)
    return units.astype(np.float32) * np.float32(metres_per_unit)


def _decoded(blob: bytes, mode: int, source: str) -> NDArray:
    try:
        with _libraries_silent():
            _check_container(blob, source)
            image = cv2.imdecode(np.frombuffer(blob, np.uint8), mode)
    except cv2.error as error:
        raise DriveError(f"{source} cannot be decoded ({error!s:.80}).") from error
    if image is None:
        raise DriveError(_damaged(blob, source))
    return np.asarray(image)


@contextmanager
def _libraries_silent() -> Iterator[None]:
    """Suppress the messages of OpenCV and Pillow about a damaged image, because our own error reports it."""
    level = cv2_logging.setLogLevel(cv2_logging.LOG_LEVEL_SILENT)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        cv2_logging.setLogLevel(level)


def _check_container(blob: bytes, source: str) -> tuple[int, int]:
    """Return width and height.

    Raises DriveError for an image of unknown format, with too many pixels, or with wrong checksums.
    """
    try:
        with Image.open(io.BytesIO(blob), formats=_FORMATS) as header:
            width, height = header.size
            _check_chunks(header, blob, source)
    except Image.DecompressionBombError as error:
        raise _too_large(source) from error
    except DriveError:
        raise
    except Exception as error:  # Pillow's readers raise many kinds of errors for damaged headers.
        kinds = ", ".join(_FORMATS)
        raise DriveError(f"{source} is not an image of a supported format ({kinds}): {len(blob):,} bytes.") from error
    if width * height > MAX_PIXELS:
        raise _too_large(source)
    return width, height


def _check_chunks(header: Image.Image, blob: bytes, source: str) -> None:
    """Verify the checksums of a PNG, because libpng would print its own message about a damaged image."""
    try:
        header.verify()
    except Exception as error:  # As above.
        raise DriveError(_damaged(blob, source)) from error


def _damaged(blob: bytes, source: str) -> str:
    return f"{source} cannot be decoded: its {len(blob):,} bytes are damaged or truncated."


def _too_large(source: str) -> DriveError:
    return DriveError(f"{source} unpacks to more than {MAX_PIXELS:,} pixels, which is larger than any supported image.")
