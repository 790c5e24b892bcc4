"""One frame as it lies in a recording: compressed pictures with exact numbers and checksums.

Owns compressing, decompressing and the checksum. Does not know where frames are stored.
"""

import json
import zlib
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ltvn_core import image_validity
from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.recording import image_codec
from ltvn_core.types import FrameId, Observation, OriginalImage, Pose, Tilt


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
    """A 16-bit PNG in millimetres, None where the robot has no depth camera."""
    original: OriginalImage | None = None
    """The camera's own picture where it was kept."""
    tilt: Tilt | None = None
    """How the camera was tilted then, where that changes."""

    @property
    def drawn_pose(self) -> Pose:
        """(3,): where the viewer shows it; the exact pose where there is one."""
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
        """CRC-32 over the original picture, its camera and its step; 0 where there is none."""
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
        rgb=image_codec.encode_rgb(observation.rgb),
        depth=None if observation.depth is None else image_codec.encode_depth(observation.depth),
        original=observation.original,
        tilt=observation.tilt,
    )


def decode_frame(frame: EncodedFrame, source: str) -> Observation:
    """Decompress a frame and pass it through the door for images; `source` names the file in errors."""
    return image_validity.check_observation(
        image_codec.decode_rgb(frame.rgb),
        None if frame.depth is None else image_codec.decode_depth(frame.depth),
        frame.odometry,
        stamp=frame.stamp,
        step=frame.step,
        exact_pose=frame.exact_pose,
        original=frame.original,
        tilt=frame.tilt,
        source=f"{source}, frame {frame.step}",
    )
