"""One frame as it lies in a recording: compressed pictures with exact numbers and checksums.

Owns compressing (RGB as JPEG, depth as 16-bit PNG in millimetres), decompressing and the checksum. Does not know where
frames are stored.
"""

import json
import zlib
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from ltvn_core import image_validity
from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.errors import RecordingError
from ltvn_core.types import Depth, FrameId, Observation, OriginalImage, Pose, Rgb, Tilt

JPEG_QUALITY = 92
_JPEG_OPTIONS = (cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY)
# Level 1 is three times as fast as the default and costs 5 % in size.
_PNG_OPTIONS = (cv2.IMWRITE_PNG_COMPRESSION, 1)
MILLIMETRES_PER_METRE = 1000.0
_FARTHEST_MM = 65535


def encode_rgb(rgb: Rgb) -> bytes:
    """Compress a picture (H, W, 3) to JPEG."""
    return _encoded(".jpg", rgb[..., ::-1], _JPEG_OPTIONS)


def encode_depth(depth: Depth) -> bytes:
    """Compress depth (H, W) in metres to a PNG of whole millimetres; beyond 65.535 m it saturates."""
    millimetres = np.clip(np.rint(depth * MILLIMETRES_PER_METRE), 0, _FARTHEST_MM).astype(np.uint16)
    return _encoded(".png", millimetres, _PNG_OPTIONS)


def decode_rgb(blob: bytes) -> Rgb:
    """Return the picture (H, W, 3) in a JPEG."""
    return np.asarray(_decoded(blob, cv2.IMREAD_COLOR_RGB), np.uint8)


def decode_depth(blob: bytes) -> Depth:
    """Return the depth (H, W) in metres in a 16-bit PNG of millimetres."""
    return (_decoded(blob, cv2.IMREAD_UNCHANGED) / MILLIMETRES_PER_METRE).astype(np.float32)


def _encoded(suffix: str, image: np.ndarray, options: tuple[int, int]) -> bytes:
    done, blob = cv2.imencode(suffix, image, options)
    if not done:
        raise RecordingError(f"An image of shape {image.shape} and {image.dtype} could not be compressed as {suffix}.")
    return blob.tobytes()


def _decoded(blob: bytes, mode: int) -> np.ndarray:
    image = cv2.imdecode(np.frombuffer(blob, np.uint8), mode)
    if image is None:
        raise RecordingError(f"A stored image of {len(blob)} bytes is damaged; run `ltvn verify` on the recording.")
    return image


@dataclass(frozen=True, slots=True, eq=False)
class EncodedFrame:
    """An observation whose pictures are still compressed; owns all its arrays."""

    step: FrameId
    stamp: float
    odometry: Pose
    exact_pose: Pose | None
    rgb: bytes
    """A JPEG."""
    depth: bytes | None
    """A 16-bit PNG in millimetres, None if the robot has no depth camera."""
    original: OriginalImage | None = None
    """The camera's own picture where it was kept."""
    tilt: Tilt | None = None
    """Tilt of the camera at that time, if it changes."""

    @property
    def drawn_pose(self) -> Pose:
        """(3,): where the viewer shows it; the exact pose if there is one."""
        return self.odometry if self.exact_pose is None else self.exact_pose

    @property
    def rgb_checksum(self) -> int:
        """CRC-32 over the picture and everything that stands in its row."""
        exact = b"" if self.exact_pose is None else self.exact_pose.tobytes()
        tilt = b"" if self.tilt is None else np.array(self.tilt, np.float64).tobytes()
        numbers = np.array([self.step, self.stamp], np.float64).tobytes() + self.odometry.tobytes() + exact + tilt
        return zlib.crc32(self.rgb, zlib.crc32(numbers))

    @property
    def depth_checksum(self) -> int:
        """CRC-32 over the depth image and its step."""
        return zlib.crc32(self.depth or b"", zlib.crc32(np.int64(self.step).tobytes()))

    @property
    def original_checksum(self) -> int:
        """CRC-32 over the original picture, its camera and its step; 0 if there is none."""
        if self.original is None:
            return 0
        camera = camera_text(self.original.camera).encode()
        return zlib.crc32(self.original.jpeg + camera, zlib.crc32(np.int64(self.step).tobytes()))


@lru_cache(maxsize=8)
def camera_text(camera: CameraModel) -> str:
    """Return a camera as JSON; all originals of a recording have the same."""
    return json.dumps(camera.to_json(), sort_keys=True)


def encode_frame(observation: Observation) -> EncodedFrame:
    """Compress an observation; nothing of it is shared with the result. Raises ImageError for an impossible instant."""
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
    """Decompress a frame and pass it through the door for images; `source` names the file in errors."""
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
