"""Images that a person uploads: decoded with care, because anything may come.

A file of a hundred kilobytes can unfold to gigabytes. So its header is asked for the size before a pixel is decoded,
pixels are made fewer before they are copied, and what it took goes back to the system.
"""

import io
import warnings

import numpy as np
from PIL import Image, ImageOps, UnidentifiedImageError

from ltvn_core.errors import ImageError
from ltvn_core.network.allocator import return_freed_memory
from ltvn_core.types import Rgb

MOST_PIXELS = {"JPEG": 25_000_000, "PNG": 12_000_000, "WEBP": 12_000_000, "BMP": 12_000_000}
"""By format, as cameras take and screens show them; decoding needs at most a quarter of a gigabyte for a moment."""
MOST_SIDE = 20_000
LEAST_SIDE = 480
"""A larger image is made smaller by a whole factor, but not below this."""


def decode_upload(name: str, content: bytes) -> Rgb:
    """Decode an uploaded file into an image (H, W, 3) of moderate size; raises ImageError."""
    try:
        return _decoded(name, content)
    finally:
        return_freed_memory()


def _decoded(name: str, content: bytes) -> Rgb:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            image = Image.open(io.BytesIO(content), formats=tuple(MOST_PIXELS))
        with image:
            _check_size(name, image)
            return np.asarray(ImageOps.exif_transpose(_smaller(image)).convert("RGB"))
    except (UnidentifiedImageError, OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise ImageError(f"{name}: this is no whole image. Upload a JPEG, PNG, WebP or BMP file.") from error


def _check_size(name: str, image: Image.Image) -> None:
    most = MOST_PIXELS[image.format or ""]
    if image.width * image.height > most or max(image.size) > MOST_SIDE:
        raise ImageError(
            f"{name}: {image.width} x {image.height} pixels are too many; {most // 10**6} million are read of a "
            f"{image.format}, and {MOST_SIDE:,} along a side. Scale it down first."
        )


def _smaller(image: Image.Image) -> Image.Image:
    """Decode an image with no more pixels than are of use."""
    image.draft("RGB", (2 * LEAST_SIDE, 2 * LEAST_SIDE))  # A JPEG can be decoded small.
    if image.mode not in ("L", "RGB"):
        image = image.convert("RGB")
    factor = min(image.size) // LEAST_SIDE
    return image.reduce(factor) if factor > 1 else image
