"""Compressed images of strangers: their size is looked at before they are decoded, and damage is one clear error."""

import io
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import cv2
import numpy as np
from cv2.utils import logging as cv2_logging
from numpy.typing import NDArray
from PIL import Image

from ltvn_core.cameras.heif_images import heif_colours, heif_size, is_heif
from ltvn_core.errors import DriveError
from ltvn_core.types import Depth, Rgb

MAX_PIXELS = 64_000_000
"""No camera that a robot carries has more; a small file that unpacks to more is no photograph."""
NO_RETURN = 65535
"""In depth of 16 bits: what some cameras say in place of 0."""
_FORMATS = ("JPEG", "PNG", "WEBP", "BMP", "PPM", "TIFF")


def encoded_size(blob: bytes, source: str) -> tuple[int, int]:
    """Return width and height of a compressed image, which is not decoded. Raises DriveError like `decode_colour`."""
    with _libraries_silent():
        return _check_container(blob, source)


def decode_colour(blob: bytes, source: str) -> Rgb:
    """Return the colours (H, W, 3) of a JPEG, PNG, HEIC or their like; one channel becomes grey.

    Args:
        blob: The compressed image.
        source: What messages call it.

    Raises:
        DriveError: The image is damaged, cut, of another format, or too large.
    """
    if is_heif(blob):
        if np.prod(heif_size(blob, source)) > MAX_PIXELS:
            raise _too_large(source)
        return heif_colours(blob, source)
    return np.asarray(_decoded(blob, cv2.IMREAD_COLOR_RGB, source), np.uint8)


def decode_depth(blob: bytes, metres_per_unit: float, source: str) -> Depth:
    """Return depth (H, W) in metres from a 16-bit PNG or a TIFF of floats; raises DriveError like `decode_colour`.

    A PNG of four channels holds the four bytes of a float in metres, as RTAB-Map writes it.
    """
    units = _decoded(blob, cv2.IMREAD_UNCHANGED, source)
    if units.dtype == np.uint8 and units.ndim == 3 and units.shape[2] == 4:
        metres = np.ascontiguousarray(units).view("<f4")[..., 0]
        return np.where(np.isfinite(metres) & (metres > 0), metres, 0).astype(np.float32)
    if units.ndim != 2 or units.dtype not in (np.uint16, np.float32):
        raise DriveError(
            f"{source} is no depth image: expected one channel of 16 bits, got shape {units.shape} of {units.dtype}."
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
    """Keep what OpenCV and Pillow say of a damaged image off the terminal, where our error says it in one line."""
    level = cv2_logging.setLogLevel(cv2_logging.LOG_LEVEL_SILENT)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        cv2_logging.setLogLevel(level)


def _check_container(blob: bytes, source: str) -> tuple[int, int]:
    """Return width and height.

    Raises DriveError where an image is of no known format, unpacks to too much, or fails its own checksums.
    """
    try:
        with Image.open(io.BytesIO(blob), formats=_FORMATS) as header:
            width, height = header.size
            _check_chunks(header, blob, source)
    except Image.DecompressionBombError as error:
        raise _too_large(source) from error
    except DriveError:
        raise
    except Exception as error:  # Pillow's readers raise many kinds for damaged headers.
        kinds = ", ".join(_FORMATS)
        raise DriveError(f"{source} is no image that can be read ({kinds}): {len(blob):,} bytes.") from error
    if width * height > MAX_PIXELS:
        raise _too_large(source)
    return width, height


def _check_chunks(header: Image.Image, blob: bytes, source: str) -> None:
    """Check the checksums of a PNG, for libpng would print its own line about a damaged one beside our error."""
    try:
        header.verify()
    except Exception as error:  # As above.
        raise DriveError(_damaged(blob, source)) from error


def _damaged(blob: bytes, source: str) -> str:
    return f"{source} cannot be decoded: its {len(blob):,} bytes are damaged or cut."


def _too_large(source: str) -> DriveError:
    return DriveError(f"{source} unpacks to more than {MAX_PIXELS:,} pixels, which no camera of a robot has.")
