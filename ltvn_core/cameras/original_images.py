"""Original images: the images of a robot's own camera, stored at a small size beside the rectified images.

With them, predictors with another image size and lens can use old recordings. Owns the size and the compression.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.errors import ImageError
from ltvn_core.types import OriginalImage

JPEG_QUALITY = 75
"""JPEG quality: an image of 320 x 240 then takes about 7 kB, which fits the budget of a step in a recording."""


class OriginalSize(NamedTuple):
    """Largest size of an original image, in pixels."""

    long_side: int = 320
    short_side: int = 240

    def scale_of(self, width: int, height: int) -> float:
        """Return the factor, at most 1, by which an image must be scaled to fit this size."""
        return min(1.0, self.long_side / max(width, height), self.short_side / min(width, height))


def compress_original(
    rgb: NDArray[np.uint8],
    camera: CameraModel,
    size: OriginalSize | None = OriginalSize(),  # noqa: B008
) -> OriginalImage:
    """Return an image (H, W, 3) of `camera` as a JPEG of at most `size`, with its aspect ratio; None keeps its size.

    Raises ImageError if it cannot be compressed.
    """
    import cv2

    scale = 1.0 if size is None else size.scale_of(rgb.shape[1], rgb.shape[0])
    if scale < 1:
        width = max(round(camera.width * scale), 1)
        height = max(round(camera.height * scale), 1)
        rgb = cv2.resize(rgb, (width, height), interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)
        camera = camera.scaled(width, height)
    done, jpeg = cv2.imencode(".jpg", rgb[..., ::-1], (cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY))
    if not done:
        raise ImageError(f"An image of shape {rgb.shape} and {rgb.dtype} could not be compressed.")
    return OriginalImage(jpeg.tobytes(), camera)


def decompress_original(image: OriginalImage) -> NDArray[np.uint8]:
    """Return the colours (H, W, 3) of an original image. Raises ImageError if its bytes are damaged."""
    import cv2

    rgb = cv2.imdecode(np.frombuffer(image.jpeg, np.uint8), cv2.IMREAD_COLOR_RGB)
    if rgb is None:
        raise ImageError(f"An original image of {len(image.jpeg)} bytes is damaged; run `ltvn verify`.")
    return np.asarray(rgb, np.uint8)
