"""Pictures in HEIC, as phones take them; read where pillow_heif is installed."""

import io
from typing import Any

import numpy as np
from PIL import Image

from ltvn_core.errors import DriveError
from ltvn_core.extras import is_installed, missing_text
from ltvn_core.types import Rgb

_LIBRARY = "pillow_heif"
_BRANDS = (b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1")


def is_heif(blob: bytes) -> bool:
    """Tell whether the bytes begin as a HEIC picture does."""
    return blob[4:8] == b"ftyp" and blob[8:12] in _BRANDS


def heif_size(blob: bytes, source: str) -> tuple[int, int]:
    """Return width and height, without decoding. Raises DriveError like `heif_colours`."""
    width, height = _opened(blob, source).size
    return width, height


def heif_colours(blob: bytes, source: str) -> Rgb:
    """Return the colours (H, W, 3), upright. Raises DriveError for a damaged picture, or without the library."""
    opened = _opened(blob, source)
    try:
        return np.array(opened.to_pillow().convert("RGB"), np.uint8)
    except Exception as error:  # The library has many kinds for damaged pictures.
        raise DriveError(_damaged(blob, source)) from error


def heif_exif(blob: bytes) -> Image.Exif:
    """Return what the camera wrote beside the picture; empty where it wrote nothing."""
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


def _damaged(blob: bytes, source: str) -> str:
    return f"{source} cannot be decoded: its {len(blob):,} bytes are damaged or cut."
