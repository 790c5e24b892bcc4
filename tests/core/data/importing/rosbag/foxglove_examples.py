"""Small MCAP files in Foxglove's own schemas, as programs without ROS write them: records one after the other."""

import base64
import json
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ltvn_core.protobuf_fields import bytes_field, number_field, varint
from tests.core.data.importing.rosbag.bag_examples import BEGIN_S, COLOUR_FRAME, FOCAL, HEIGHT, WIDTH, Place

_MAGIC = b"\x89MCAP0\r\n"
_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _DATA_END = 1, 2, 3, 4, 5, 15
_FIXED = {"width", "height", "step"}


def _numbered(names: str) -> dict[str, int]:
    return {name: number for number, name in enumerate(names.split(), 1)}


_NUMBERS = {
    "CompressedImage": {"timestamp": 1, "data": 2, "format": 3, "frame_id": 4},
    "CompressedVideo": {"timestamp": 1, "frame_id": 2, "data": 3, "format": 4},
    "RawImage": _numbered("timestamp width height encoding step data frame_id"),
    "CameraCalibration": _numbered("timestamp width height distortion_model D K R P frame_id"),
    "FrameTransform": _numbered("timestamp parent_frame_id child_frame_id translation rotation"),
    "FrameTransforms": {"transforms": 1},
    "PoseInFrame": {"timestamp": 1, "frame_id": 2, "pose": 3},
}
_INNER = {"sec": 1, "nsec": 2, "position": 1, "orientation": 2, "x": 1, "y": 2, "z": 3, "w": 4}


def protobuf(name: str, fields: Mapping[str, Any]) -> bytes:
    """Encode a message of one of Foxglove's schemas, without what is 0 or empty."""
    return b"".join(_field(_NUMBERS.get(name, _INNER)[key], key, value) for key, value in fields.items())


def as_json(fields: Mapping[str, Any]) -> bytes:
    def encode(value: Any) -> Any:
        return base64.b64encode(value).decode() if isinstance(value, bytes) else value.tolist()

    return json.dumps(fields, default=encode).encode()


def _field(number: int, key: str, value: Any) -> bytes:
    if isinstance(value, Mapping):
        return bytes_field(number, protobuf("", value))
    if isinstance(value, list):
        return b"".join(bytes_field(number, protobuf("FrameTransform", each)) for each in value)
    if isinstance(value, np.ndarray):
        return bytes_field(number, value.astype("<f8").tobytes())
    if isinstance(value, (str, bytes)):
        return bytes_field(number, value.encode() if isinstance(value, str) else value)
    if not value:
        return b""
    if key in _FIXED:
        return varint(number << 3 | 5) + struct.pack("<I", value)
    return number_field(number, value) if isinstance(value, int) else varint(number << 3 | 1) + struct.pack("<d", value)


class FoxgloveFile:
    """Writes an MCAP file without chunks and without an index."""

    def __init__(self, path: Path, encoding: str = "protobuf", profile: str = "") -> None:
        self._file = path.open("wb")
        self._encoding = encoding
        self._channels: dict[str, int] = {}
        self._file.write(_MAGIC)
        self._record(_HEADER, _text(profile) + _text("test"))

    def __enter__(self) -> "FoxgloveFile":
        return self

    def __exit__(self, *_: object) -> None:
        self._record(_DATA_END, bytes(4))
        self._record(_FOOTER, bytes(20))
        self._file.write(_MAGIC)
        self._file.close()

    def write(self, topic: str, name: str, fields: Mapping[str, Any], log_s: float) -> None:
        """Write a message of Foxglove's schema `name`, encoded as the file is."""
        data = as_json(fields) if self._encoding == "json" else protobuf(name, fields)
        schema = "jsonschema" if self._encoding == "json" else "protobuf"
        self.write_raw(topic, f"foxglove.{name}", (schema, self._encoding), data, log_s)

    def write_raw(self, topic: str, name: str, encodings: tuple[str, str], data: bytes, log_s: float) -> None:
        """Write a message of any schema; `encodings` are those of schema and messages."""
        if topic not in self._channels:
            number = self._channels[topic] = len(self._channels) + 1
            ids = struct.pack("<H", number)
            self._record(_SCHEMA, ids + _text(name) + _text(encodings[0]) + _text(""))
            self._record(_CHANNEL, ids + ids + _text(topic) + _text(encodings[1]) + _text(""))
        time = round(log_s * 1e9)
        self._record(_MESSAGE, struct.pack("<HIQQ", self._channels[topic], 0, time, time) + data)

    def _record(self, kind: int, content: bytes) -> None:
        self._file.write(struct.pack("<BQ", kind, len(content)) + content)


def _text(said: str) -> bytes:
    return struct.pack("<I", len(said.encode())) + said.encode()


def time(stamp: float) -> dict[str, int]:
    nanoseconds = round(stamp * 1e9)
    return {"sec": nanoseconds // 10**9, "nsec": nanoseconds % 10**9}


def frame_transform(parent: str, child: str, place: Place, stamp: float) -> dict[str, Any]:
    return {
        "timestamp": time(stamp),
        "parent_frame_id": parent,
        "child_frame_id": child,
        "translation": dict(zip("xyz", map(float, place.xyz), strict=True)),
        "rotation": dict(zip("xyzw", map(float, place.turn.as_quat()), strict=True)),
    }


def raw_image(pixels: np.ndarray, encoding: str, stamp: float) -> dict[str, Any]:
    return {
        "timestamp": time(stamp),
        "frame_id": COLOUR_FRAME,
        "width": pixels.shape[1],
        "height": pixels.shape[0],
        "encoding": encoding,
        "step": pixels.strides[0],
        "data": pixels.tobytes(),
    }


def calibration() -> dict[str, Any]:
    cx, cy = (WIDTH - 1) / 2, (HEIGHT - 1) / 2
    return {
        "timestamp": time(BEGIN_S),
        "frame_id": COLOUR_FRAME,
        "width": WIDTH,
        "height": HEIGHT,
        "distortion_model": "plumb_bob",
        "D": np.zeros(5),
        "K": np.array([FOCAL, 0, cx, 0, FOCAL, cy, 0, 0, 1]),
        "R": np.eye(3).ravel(),
        "P": np.array([FOCAL, 0, cx, 0, 0, FOCAL, cy, 0, 0, 0, 1, 0]),
    }
