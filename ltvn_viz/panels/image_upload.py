"""Images that a person uploads: decoded with care, because anything may come."""

import io
import warnings

import numpy as np
from PIL import Image, ImageOps, UnidentifiedImageError

from ltvn_core import preprocessing
from ltvn_core.errors import ImageError
from ltvn_core.types import Rgb

MOST_PIXELS = 60_000_000
FORMATS = ("JPEG", "PNG", "WEBP", "BMP")


def decode_upload(name: str, content: bytes) -> Rgb:
    """Decode an uploaded file into an image of the method's size (72, 96, 3); raises ImageError."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            image = Image.open(io.BytesIO(content), formats=FORMATS)
        if image.width * image.height > MOST_PIXELS:
            raise ImageError(f"{name}: {image.width} x {image.height} pixels are too many; scale it down first.")
        upright = ImageOps.exif_transpose(image).convert("RGB")
    except (UnidentifiedImageError, OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise ImageError(f"{name}: this is no whole image. Upload a JPEG, PNG, WebP or BMP file.") from error
    return preprocessing.preprocess_image(np.asarray(upright), name)
