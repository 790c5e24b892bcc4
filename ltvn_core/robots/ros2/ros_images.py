"""Decodes image messages of ROS, in any encoding, to colours and to depth in metres.

Owns the encodings of `sensor_msgs/Image` and the formats of `sensor_msgs/CompressedImage`.
"""

import struct
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import MILLIMETRES
from ltvn_core.cameras.encoded_images import NO_RETURN, decode_colour, decode_depth, decode_rvl, encoded_size
from ltvn_core.errors import DriveError
from ltvn_core.types import Depth, Rgb

IMAGE = "sensor_msgs/msg/Image"
COMPRESSED_IMAGE = "sensor_msgs/msg/CompressedImage"

DEPTH_HEADER = struct.Struct("<iff")
"""Header of a `compressedDepth` message: the kind of compression, and two constants for depth in floats."""
_PNG_MAGIC = b"\x89PNG\r\n\x1a\n"
_PNG_HEAD_BYTES = 26
_PNG_GREY_16 = b"\x10\x00"
"""Bytes of a PNG after width and height: 16 bits, one channel."""
_RVL_HEADER = struct.Struct("<II")
_MOST_PIXELS = 16_000_000


class _Layout(NamedTuple):
    dtype: type[np.generic]
    channels: int
    to_rgb: int | None
    """OpenCV's conversion code; None if the image is RGB already."""
    rows_per_line: float = 1.0
    """Rows of data per line of the image; 1.5 for colours in planes."""


_COLOURS = {
    "rgb8": _Layout(np.uint8, 3, None),
    "bgr8": _Layout(np.uint8, 3, cv2.COLOR_BGR2RGB),
    "8uc3": _Layout(np.uint8, 3, cv2.COLOR_BGR2RGB),
    "rgba8": _Layout(np.uint8, 4, cv2.COLOR_RGBA2RGB),
    "bgra8": _Layout(np.uint8, 4, cv2.COLOR_BGRA2RGB),
    "8uc4": _Layout(np.uint8, 4, cv2.COLOR_BGRA2RGB),
    "rgb16": _Layout(np.uint16, 3, None),
    "bgr16": _Layout(np.uint16, 3, cv2.COLOR_BGR2RGB),
    "mono8": _Layout(np.uint8, 1, cv2.COLOR_GRAY2RGB),
    "8uc1": _Layout(np.uint8, 1, cv2.COLOR_GRAY2RGB),
    "mono16": _Layout(np.uint16, 1, cv2.COLOR_GRAY2RGB),
    "bayer_rggb8": _Layout(np.uint8, 1, cv2.COLOR_BayerRGGB2RGB),
    "bayer_bggr8": _Layout(np.uint8, 1, cv2.COLOR_BayerBGGR2RGB),
    "bayer_gbrg8": _Layout(np.uint8, 1, cv2.COLOR_BayerGBRG2RGB),
    "bayer_grbg8": _Layout(np.uint8, 1, cv2.COLOR_BayerGRBG2RGB),
    "bayer_rggb16": _Layout(np.uint16, 1, cv2.COLOR_BayerRGGB2RGB),
    "bayer_bggr16": _Layout(np.uint16, 1, cv2.COLOR_BayerBGGR2RGB),
    "bayer_gbrg16": _Layout(np.uint16, 1, cv2.COLOR_BayerGBRG2RGB),
    "bayer_grbg16": _Layout(np.uint16, 1, cv2.COLOR_BayerGRBG2RGB),
    "yuv422": _Layout(np.uint8, 2, cv2.COLOR_YUV2RGB_UYVY),
    "uyvy": _Layout(np.uint8, 2, cv2.COLOR_YUV2RGB_UYVY),
    "yuv422_yuy2": _Layout(np.uint8, 2, cv2.COLOR_YUV2RGB_YUY2),
    "yuyv": _Layout(np.uint8, 2, cv2.COLOR_YUV2RGB_YUY2),
    "nv12": _Layout(np.uint8, 1, cv2.COLOR_YUV2RGB_NV12, 1.5),
    "nv21": _Layout(np.uint8, 1, cv2.COLOR_YUV2RGB_NV21, 1.5),
}
_DEPTHS = {
    "16uc1": _Layout(np.uint16, 1, None),
    "mono16": _Layout(np.uint16, 1, None),
    "32fc1": _Layout(np.float32, 1, None),
    "64fc1": _Layout(np.float64, 1, None),
}


def shows_depth(message: Any) -> bool:
    """Tell whether an image message holds depth, by its encoding or format."""
    said = str(getattr(message, "encoding", "") or getattr(message, "format", "")).lower()
    return said.startswith(("16uc1", "32fc1", "64fc1")) or "compresseddepth" in said


def has_sixteen_bits(message: Any) -> bool:
    """Tell whether an image message has one channel of 16 bits: depth, or the grey of an infrared camera."""
    if hasattr(message, "encoding"):
        return str(message.encoding).lower() in ("mono16", "16uc1")
    head = bytes(message.data[:_PNG_HEAD_BYTES])
    return head.startswith(_PNG_MAGIC) and head[24:] == _PNG_GREY_16


def has_metres(message: Any) -> bool:
    """Tell whether an image message holds floating-point numbers, which ROS counts in metres."""
    said = str(getattr(message, "encoding", "") or getattr(message, "format", "")).lower()
    return said.startswith(("32fc1", "64fc1"))


def image_size(message: Any, source: str) -> tuple[int, int]:
    """Return width and height of an image message without decoding it.

    Raises DriveError if they are invalid, or too large to decode without delaying a robot.
    """
    if hasattr(message, "encoding"):
        width, height = int(message.width), int(message.height)
    else:
        data, form = bytes(message.data), str(message.format)
        content = _behind_header(data, source) if _is_depth_format(form) else data
        is_rvl = _is_depth_format(form) and _is_rvl(form)
        width, height = _rvl_size(content, source) if is_rvl else encoded_size(content, source)
    if not 0 < width * height <= _MOST_PIXELS:
        raise DriveError(f"{source}: {width} x {height} pixels is not a valid size of a camera image.")
    return width, height


def decode_colours(message: Any, source: str) -> Rgb:
    """Return the colours (H, W, 3) of an image message, which `source` names. Raises DriveError."""
    if not hasattr(message, "encoding"):
        return decode_colour(bytes(message.data), source)
    layout = _layout(message, _COLOURS, source)
    image = _pixels(message, layout, source)
    if image.dtype == np.uint16:
        image = (image >> 8).astype(np.uint8)
    if layout.to_rgb is None:
        return np.ascontiguousarray(image)
    try:
        return np.asarray(cv2.cvtColor(np.ascontiguousarray(image), layout.to_rgb), np.uint8)
    except cv2.error as error:  # Such as colours per pair of pixels, with an odd width.
        raise DriveError(f"{source}: {image.shape} cannot be {message.encoding}.") from error


def decode_metres(message: Any, source: str, unit_m: float = MILLIMETRES) -> Depth:
    """Return depth (H, W) in metres, 0 = no return, of an image message; integers are in units of `unit_m`.

    Raises DriveError.
    """
    if not hasattr(message, "encoding"):
        return _clean(_compressed_metres(bytes(message.data), str(message.format), source, unit_m))
    image = _pixels(message, _layout(message, _DEPTHS, source), source)
    if image.dtype == np.uint16:
        return _clean(np.where(image == NO_RETURN, 0, image) * np.float32(unit_m))
    return _clean(image.astype(np.float32))


def _layout(message: Any, known: dict[str, _Layout], source: str) -> _Layout:
    layout = known.get(str(message.encoding).lower())
    if layout is None:
        raise DriveError(f"{source}: the encoding {message.encoding!r:.40} is not one of {', '.join(known)}.")
    return layout


def _pixels(message: Any, layout: _Layout, source: str) -> NDArray:
    """Return the data of an image as (rows, W) or (rows, W, channels), without the padding at the end of each line."""
    width = int(message.width)
    rows = int(message.height * layout.rows_per_line)
    step = int(message.step)
    dtype = np.dtype(layout.dtype).newbyteorder(">" if message.is_bigendian else "<")
    line = width * layout.channels * dtype.itemsize
    if not (0 < line <= step and rows > 0 and rows * step <= message.data.size):
        raise DriveError(
            f"{source}: {message.data.size:,} bytes in lines of {step} are no {width} x {message.height} image of "
            f"{message.encoding}."
        )
    lines = message.data[: rows * step].reshape(rows, step)[:, :line]
    pixels = np.ascontiguousarray(lines).view(dtype).astype(layout.dtype, copy=False)
    return pixels if layout.channels == 1 else pixels.reshape(rows, width, layout.channels)


def _compressed_metres(data: bytes, form: str, source: str, unit_m: float) -> Depth:
    if not _is_depth_format(form):
        return decode_depth(data, unit_m, source)
    content = _behind_header(data, source)
    if _is_rvl(form):
        width, height = _rvl_size(content, source)
        steps = decode_rvl(content[_RVL_HEADER.size :], width, height, source).astype(np.float32)
    else:
        steps = decode_depth(content, 1.0, source)
    _, scale, offset = DEPTH_HEADER.unpack_from(data)
    if not form.lower().startswith("32fc1"):
        return steps * np.float32(unit_m)
    # Floats are sent as 16 bits of inverse depth.
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return np.where(steps > 0, np.float32(scale) / (steps - np.float32(offset)), 0).astype(np.float32)


def _is_depth_format(form: str) -> bool:
    return "compresseddepth" in form.lower()


def _is_rvl(form: str) -> bool:
    return form.lower().rstrip().endswith("rvl")


def _behind_header(data: bytes, source: str) -> bytes:
    if len(data) <= DEPTH_HEADER.size:
        raise DriveError(f"{source}: {len(data)} bytes are not compressed depth.")
    return data[DEPTH_HEADER.size :]


def _rvl_size(data: bytes, source: str) -> tuple[int, int]:
    if len(data) < _RVL_HEADER.size:
        raise DriveError(f"{source}: {len(data)} bytes are not compressed depth.")
    width, height = _RVL_HEADER.unpack_from(data)
    return width, height


def _clean(metres: Depth) -> Depth:
    return np.where(np.isfinite(metres) & (metres > 0), metres, 0).astype(np.float32)
