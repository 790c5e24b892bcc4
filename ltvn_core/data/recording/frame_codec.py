"""Encoding of one frame in a recording: compressed images, exact numbers and checksums.

Owns compression (RGB as JPEG, depth as 16-bit PNG in millimetres), decompression and the checksum. Independent of where
frames are stored.
"""

import io
import json
import math
import zlib
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from PIL import Image

from ltvn_core import image_validity
from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.cameras.encoded_images import MAX_PIXELS
from ltvn_core.errors import RecordingError
from ltvn_core.types import Depth, FrameId, Observation, OriginalImage, Pose, Rgb, Tilt

JPEG_QUALITY = 92
_JPEG_OPTIONS = (cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY)
# Level 1 is three times as fast as the default, and files are 5 % larger.
_PNG_OPTIONS = (cv2.IMWRITE_PNG_COMPRESSION, 1)
MILLIMETRES_PER_METRE = 1000.0
_FARTHEST_MM = 65535


def encode_rgb(rgb: Rgb) -> bytes:
    """Compress an image (H, W, 3) to JPEG."""
    return _encoded(".jpg", rgb[..., ::-1], _JPEG_OPTIONS)


def encode_depth(depth: Depth) -> bytes:
    """Compress depth (H, W) in metres to a PNG of whole millimetres; values beyond 65.535 m become 65.535 m."""
    millimetres = np.clip(np.rint(depth * MILLIMETRES_PER_METRE), 0, _FARTHEST_MM).astype(np.uint16)
    return _encoded(".png", millimetres, _PNG_OPTIONS)


def decode_rgb(blob: bytes) -> Rgb:
    """Return the image (H, W, 3) of a JPEG."""
    return np.asarray(_decoded(blob, cv2.IMREAD_COLOR_RGB), np.uint8)


def decode_depth(blob: bytes) -> Depth:
    """Return the depth (H, W) in metres of a 16-bit PNG in millimetres."""
    return (_decoded(blob, cv2.IMREAD_UNCHANGED) / MILLIMETRES_PER_METRE).astype(np.float32)


def _encoded(suffix: str, image: np.ndarray, options: tuple[int, int]) -> bytes:
    done, blob = cv2.imencode(suffix, image, options)
    if not done:
        raise RecordingError(f"An image of shape {image.shape} and {image.dtype} could not be compressed as {suffix}.")
    return blob.tobytes()


def _decoded(blob: bytes, mode: int) -> np.ndarray:
    try:
        with Image.open(io.BytesIO(blob), formats=("JPEG", "PNG")) as header:
            is_possible = math.prod(header.size) <= MAX_PIXELS
        image = cv2.imdecode(np.frombuffer(blob, np.uint8), mode) if is_possible else None
    except (Image.DecompressionBombError, OSError, SyntaxError, ValueError, cv2.error):
        image = None
    if image is None:
        raise RecordingError(f"A stored image of {len(blob)} bytes is damaged; run `ltvn verify` on the recording.")
    return image


@dataclass(frozen=True, slots=True, eq=False)
class EncodedFrame:
    """An observation whose images are still compressed; owns all its arrays."""

    step: FrameId
    stamp: float
    odometry: Pose
    exact_pose: Pose | None
    rgb: bytes
    """Colour image as JPEG."""
    depth: bytes | None
    """Depth as a 16-bit PNG in millimetres; None if the robot has no depth camera."""
    original: OriginalImage | None = None
    """The camera's original image; None if it was not kept."""
    tilt: Tilt | None = None
    """Tilt of the camera at that time; None if it equals the mounting."""

    @property
    def drawn_pose(self) -> Pose:
        """Pose (3,) in the viewer: the exact pose if there is one, otherwise the odometry."""
        return self.odometry if self.exact_pose is None else self.exact_pose

    @property
    def rgb_checksum(self) -> int:
        """CRC-32 of the image and all other data in its row."""
        exact = b"" if self.exact_pose is None else self.exact_pose.tobytes()
        tilt = b"" if self.tilt is None else np.array(self.tilt, np.float64).tobytes()
        numbers = np.array([self.step, self.stamp], np.float64).tobytes() + self.odometry.tobytes() + exact + tilt
        return zlib.crc32(self.rgb, zlib.crc32(numbers))

    @property
    def depth_checksum(self) -> int:
        """CRC-32 of the depth image and its step."""
        return zlib.crc32(self.depth or b"", zlib.crc32(np.int64(self.step).tobytes()))

    @property
    def original_checksum(self) -> int:
        """CRC-32 of the original image, its camera and its step; 0 if there is none."""
        if self.original is None:
            return 0
        camera = camera_text(self.original.camera).encode()
        return zlib.crc32(self.original.jpeg + camera, zlib.crc32(np.int64(self.step).tobytes()))


@lru_cache(maxsize=8)
def camera_text(camera: CameraModel) -> str:
    """Return a camera as JSON, which is the same for all original images of a recording."""
    return json.dumps(camera.to_json(), sort_keys=True)


def encode_frame(observation: Observation) -> EncodedFrame:
    """Compress an observation; the result shares no memory with it. Raises ImageError for an invalid pose, stamp or
    step."""
    exact = observation.exact_pose
    odometry, stamp, step = image_validity.check_instant(
        observation.odometry, stamp=observation.stamp, step=observation.step, source="recording"
    )
    return EncodedFrame(
        step=step,
        stamp=stamp,
        odometry=odometry.copy(),
        exact_pose=None if exact is None else np.array(exact, np.float64),
        rgb=encode_rgb(observation.rgb),
        depth=None if observation.depth is None else encode_depth(observation.depth),
        original=observation.original,
        tilt=observation.tilt,
    )


def decode_frame(frame: EncodedFrame, source: str) -> Observation:
    """Decompress a frame and check it as all images are; `source` is its name in errors."""
    return image_validity.check_observation(
        decode_rgb(frame.rgb),
        None if frame.depth is None else decode_depth(frame.depth),
        frame.odometry,
        stamp=frame.stamp,
        step=frame.step,
        exact_pose=frame.exact_pose,
        original=frame.original,
        tilt=frame.tilt,
        source=f"{source}, frame {frame.step}",
    )
