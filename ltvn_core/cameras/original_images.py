"""Original images: the picture of a robot's own camera, kept small beside the one that the method uses.

Another predictor, with another size and lens, can then work on old recordings. Owns the size and the compression.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.errors import ImageError
from ltvn_core.types import OriginalImage

JPEG_QUALITY = 75
"""A picture of 320 x 240 then takes about 7 kB, and a step of a recording with it stays within its budget."""


class OriginalSize(NamedTuple):
    """The largest original picture that is kept, in pixels."""

    long_side: int = 320
    short_side: int = 240

    def scale_of(self, width: int, height: int) -> float:
        """Return by what factor, at most 1, a picture must be scaled to be no larger than this."""
        return min(1.0, self.long_side / max(width, height), self.short_side / min(width, height))


def compress_original(
    rgb: NDArray[np.uint8],
    camera: CameraModel,
    size: OriginalSize | None = OriginalSize(),  # noqa: B008
) -> OriginalImage:
    """Return the picture (H, W, 3) of `camera` as a JPEG of at most `size`, of any size for None; the aspect stays.

    Raises ImageError where it cannot be compressed.
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
        raise ImageError(f"A picture of shape {rgb.shape} and {rgb.dtype} could not be compressed.")
    return OriginalImage(jpeg.tobytes(), camera)


def decompress_original(image: OriginalImage) -> NDArray[np.uint8]:
    """Return the colours (H, W, 3) of an original picture. Raises ImageError when its bytes are damaged."""
    import cv2

    rgb = cv2.imdecode(np.frombuffer(image.jpeg, np.uint8), cv2.IMREAD_COLOR_RGB)
    if rgb is None:
        raise ImageError(f"An original picture of {len(image.jpeg)} bytes is damaged; run `ltvn verify`.")
    return np.asarray(rgb, np.uint8)
