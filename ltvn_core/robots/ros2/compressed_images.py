"""Images as `image_transport` compresses them: colours as JPEG, depth as PNG of millimetres behind its own header."""

from typing import Any

import cv2
import numpy as np

from ltvn_core.cameras.camera_model import MILLIMETRES
from ltvn_core.robots.ros2.ros_images import COMPRESSED_IMAGE, DEPTH_HEADER
from ltvn_core.robots.ros2.ros_messages import CAMERA_FRAME, header
from ltvn_core.robots.ros2.ros_types import type_store
from ltvn_core.types import Depth, Rgb

_QUALITY = 95
_FARTHEST = 65535


def compressed_colour_message(rgb: Rgb, stamp_s: float) -> Any:
    """Return colours (H, W, 3) as a JPEG."""
    _, jpeg = cv2.imencode(".jpg", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), (cv2.IMWRITE_JPEG_QUALITY, _QUALITY))
    return _message(jpeg.tobytes(), "rgb8; jpeg compressed bgr8", stamp_s)


def compressed_depth_message(depth: Depth, stamp_s: float) -> Any:
    """Return depth (H, W) in metres as whole millimetres in a PNG."""
    units = np.clip(np.nan_to_num(np.round(depth / MILLIMETRES), posinf=0), 0, _FARTHEST).astype(np.uint16)
    return _message(
        DEPTH_HEADER.pack(0, 0.0, 0.0) + cv2.imencode(".png", units)[1].tobytes(), "16UC1; compressedDepth png", stamp_s
    )


def _message(data: bytes, form: str, stamp_s: float) -> Any:
    content = np.frombuffer(data, np.uint8)
    return type_store().types[COMPRESSED_IMAGE](header=header(stamp_s, CAMERA_FRAME), format=form, data=content)
