"""Converts messages of other makers to equivalent ROS messages, so that one reader serves all of them.

Owns the table of equivalent types: Foxglove's in protobuf, in JSON and as ROS messages, and video packets. Foxglove's
schemas have public and fixed field numbers and names; a schema in the file is never read. A result has the fields of
the ROS message, but need not be of its class.
"""

import base64
import struct
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from rosbags.interfaces import Connection, ConnectionExtRosbag2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from ltvn_core.data.importing.rosbag.video_stream import as_video
from ltvn_core.protobuf_fields import read_fields
from ltvn_core.robots.ros2.ros_cameras import CAMERA_INFO
from ltvn_core.robots.ros2.ros_images import COMPRESSED_IMAGE, IMAGE
from ltvn_core.structured_text import parse_json

PROTOBUF = "protobuf"
JSON = "json"
CDR = "cdr"
ROS1 = "ros1"
POSE_IN_FRAME = "PoseInFrame"
_MOST_FIELDS = 100_000
"""Largest number of fields of one message, with those of nested messages; a robot has a few hundred frames."""
_MOST_JSON_BYTES = 2**26
"""Largest size of a JSON message in bytes; parsed, it takes twenty times as much memory. A 4K image in base64 has 33
MB."""
_TF = "tf2_msgs/msg/TFMessage"
_PACKET = "ffmpeg_image_transport_msgs/msg/FFMPEGPacket"
_ROS_FOXGLOVE = "foxglove_msgs/msg/"

_FIELDS = {
    "Time": "int sec, int nanosec",
    "Vector": "double x, double y, double z",
    "Quaternion": "double x, double y, double z, double w",
    "Pose": "Vector position, Quaternion orientation",
    "CompressedImage": "Time timestamp, bytes data, text format, text frame_id",
    "CompressedVideo": "Time timestamp, text frame_id, bytes data, text format",
    "RawImage": "Time timestamp, int width, int height, text encoding, int step, bytes data, text frame_id",
    "CameraCalibration": (
        "Time timestamp, int width, int height, text distortion_model, double[] d, double[] k, double[] r, double[] p, "
        "text frame_id"
    ),
    "FrameTransform": (
        "Time timestamp, text parent_frame_id, text child_frame_id, Vector translation, Quaternion rotation"
    ),
    "FrameTransforms": "FrameTransform[] transforms",
    POSE_IN_FRAME: "Time timestamp, text frame_id, Pose pose",
}
"""Kind and name of each field of Foxglove's messages, in the order of their numbers in protobuf, which begin at 1."""
_SCHEMAS = {message: [field.split() for field in fields.split(", ")] for message, fields in _FIELDS.items()}
_JSON_NAMES = {"nanosec": "nsec", "d": "D", "k": "K", "r": "R", "p": "P"}
"""Names of fields in JSON that differ from those in ROS."""


def read_message(data: bytes, encoding: str, name: str) -> SimpleNamespace:
    """Return the fields of a message by their names in ROS; missing fields are 0 or empty.

    Args:
        data: The encoded message.
        encoding: `PROTOBUF` or `JSON`.
        name: A Foxglove schema without its prefix.

    Raises:
        ValueError: The data is not a message of this schema.
        TypeError: A JSON field has the wrong type.
    """
    if encoding == PROTOBUF:
        return _ProtobufReader().read(data, name)
    if len(data) > _MOST_JSON_BYTES:
        raise ValueError(f"{len(data):,} bytes of JSON, but at most {_MOST_JSON_BYTES:,} are read")
    return _json_fields(parse_json(data), name)


class _ProtobufReader:
    """Reads one message, and counts its fields."""

    def __init__(self) -> None:
        self._count = 0

    def read(self, data: bytes, schema: str) -> SimpleNamespace:
        found: dict[int, list[int | bytes]] = {}
        for field in read_fields(data):
            self._count += 1
            if self._count > _MOST_FIELDS:
                raise ValueError(f"it has more than {_MOST_FIELDS:,} fields")
            found.setdefault(field.number, []).append(field.value)
        numbered = enumerate(_SCHEMAS[schema], start=1)
        return SimpleNamespace(**{name: self._value(kind, found.get(number, [])) for number, (kind, name) in numbered})

    def _value(self, kind: str, values: list[int | bytes]) -> Any:
        match kind:
            case "int":
                value = values[-1] if values else 0
                return value if isinstance(value, int) else int.from_bytes(value, "little")
            case "double":
                return struct.unpack("<d", _bytes(values[-1]))[0] if values else 0.0
            case "double[]":  # Packed, or one value at a time.
                return np.frombuffer(b"".join(map(_bytes, values)), "<f8")
            case "text":
                return _bytes(values[-1]).decode(errors="replace") if values else ""
            case "bytes":
                return np.frombuffer(_bytes(values[-1]) if values else b"", np.uint8)
            case _ if kind.endswith("[]"):
                return [self.read(_bytes(value), kind.removesuffix("[]")) for value in values]
            case _:  # Protobuf may split one message into parts, which must be joined.
                return self.read(b"".join(map(_bytes, values)), kind)


def _bytes(value: int | bytes) -> bytes:
    if isinstance(value, int):
        raise ValueError("there is a number where the schema has bytes")
    return value


def _json_fields(said: Any, schema: str) -> SimpleNamespace:
    if not isinstance(said, dict):
        raise ValueError(f"expected a JSON object, got {type(said).__name__}")
    fields = _SCHEMAS[schema]
    return SimpleNamespace(**{name: _json_value(kind, said.get(_JSON_NAMES.get(name, name))) for kind, name in fields})


def _json_value(kind: str, said: Any) -> Any:
    match kind:
        case "int":
            return int(said or 0)
        case "double":
            return float(said or 0)
        case "double[]":
            return np.asarray([float(number) for number in said or ()], np.float64)
        case "text":
            return str(said or "")
        case "bytes":
            return np.frombuffer(base64.b64decode(said or ""), np.uint8)
        case _ if kind.endswith("[]"):
            return [_json_fields(each, kind.removesuffix("[]")) for each in said or ()]
        case _:
            return _json_fields(said or {}, kind)


class Written(NamedTuple):
    """Encoding and schema of the messages of a channel."""

    encoding: str
    """Encoding: `cdr`, `ros1`, `protobuf`, `json`, or one that is not supported."""
    schema: str
    """Name of the message type in the file."""

    @classmethod
    def of(cls, connection: Connection) -> "Written":
        """Return the encoding and schema of a connection's messages."""
        extension = connection.ext
        encoding = extension.serialization_format if isinstance(extension, ConnectionExtRosbag2) else ROS1
        return cls(encoding or "unknown", connection.msgtype)

    @property
    def foxglove(self) -> str:
        """Name of the schema without its prefix; "" if it is not a supported Foxglove schema."""
        prefix = "foxglove." if self.encoding in (PROTOBUF, JSON) else _ROS_FOXGLOVE
        name = self.schema.removeprefix(prefix) if self.schema.startswith(prefix) else ""
        return name if name in _FOXGLOVE else ""

    @property
    def msgtype(self) -> str | None:
        """ROS message type as which the messages are read; None if they are not supported."""
        if self.foxglove:
            return _FOXGLOVE[self.foxglove].msgtype
        if self.encoding not in (CDR, ROS1):
            return None
        return COMPRESSED_IMAGE if self.schema == _PACKET else self.schema


class MessageReader:
    """Decodes the messages of one bag."""

    def __init__(self, *, ros1: bool) -> None:
        """Load the message types of ROS 1 or ROS 2."""
        self._store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.LATEST)
        added = {f"{_ROS_FOXGLOVE}{name}": each.definition for name, each in _FOXGLOVE.items()}
        added[_PACKET] = _PACKETS[ros1]
        if ros1:
            added |= dict.fromkeys((_TF, "tf/msg/tfMessage"), "geometry_msgs/TransformStamped[] transforms")
        for name, definition in added.items():
            self._store.register(get_types_from_msg(definition, name))

    def read(self, data: bytes, written: Written) -> Any:
        """Return a message in ROS's form. Raises any exception for a damaged message, because the library trusts its
        lengths."""
        if written.encoding in (PROTOBUF, JSON):
            return _FOXGLOVE[written.foxglove].converted(read_message(data, written.encoding, written.foxglove))
        read = self._store.deserialize_ros1 if written.encoding == ROS1 else self._store.deserialize_cdr
        message = read(data, written.schema)
        if written.foxglove:
            return _FOXGLOVE[written.foxglove].converted(message)
        return _packet(message) if written.schema == _PACKET else message


def _stamped(message: Any, frame: str, **fields: Any) -> Any:
    return SimpleNamespace(header=SimpleNamespace(stamp=message.timestamp, frame_id=frame), **fields)


def _packet(message: Any) -> Any:
    return SimpleNamespace(header=message.header, format=as_video(message.encoding), data=message.data)


def _compressed(message: Any) -> Any:
    return _stamped(message, message.frame_id, format=message.format, data=message.data)


def _video(message: Any) -> Any:
    return _stamped(message, message.frame_id, format=as_video(message.format), data=message.data)


def _image(message: Any) -> Any:
    copied = {name: getattr(message, name) for name in ("height", "width", "encoding", "step", "data")}
    return _stamped(message, message.frame_id, is_bigendian=0, **copied)


def _camera_info(message: Any) -> Any:
    """Return a CameraInfo without a region of interest. Raises ValueError for matrices of a wrong size."""
    # ROS 1 uses capital letters for these fields.
    d, k, p = (np.asarray(getattr(message, name, getattr(message, name.upper(), ())), np.float64) for name in "dkp")
    if k.size not in (0, 9) or p.size not in (0, 12):
        raise ValueError(f"K has {k.size} numbers and P has {p.size}, expected 9 and 12")
    copied = {name: getattr(message, name) for name in ("width", "height", "distortion_model")}
    whole = SimpleNamespace(x_offset=0, y_offset=0, width=0, height=0)
    return _stamped(message, message.frame_id, d=d, k=k, p=p, roi=whole, **copied)


def _transform(message: Any) -> Any:
    pose = SimpleNamespace(translation=message.translation, rotation=_turn(message.rotation))
    return _stamped(message, message.parent_frame_id, child_frame_id=message.child_frame_id, transform=pose)


def _pose(message: Any) -> Any:
    pose = SimpleNamespace(position=message.pose.position, orientation=_turn(message.pose.orientation))
    return _stamped(message, message.frame_id, pose=pose)


def _turn(said: Any) -> Any:
    """Return a rotation; the identity if all fields are 0, because protobuf omits such fields."""
    return said if any((said.x, said.y, said.z, said.w)) else SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0)


class _Equivalent(NamedTuple):
    msgtype: str
    """Message type of ROS."""
    converted: Callable[[Any], Any]
    definition: str
    """Definition of Foxglove's message in ROS."""


_STAMPED = "builtin_interfaces/Time timestamp\nstring frame_id\n"
_FOXGLOVE = {
    "CompressedImage": _Equivalent(COMPRESSED_IMAGE, _compressed, f"{_STAMPED}uint8[] data\nstring format\n"),
    "CompressedVideo": _Equivalent(COMPRESSED_IMAGE, _video, f"{_STAMPED}uint8[] data\nstring format\n"),
    "RawImage": _Equivalent(
        IMAGE, _image, f"{_STAMPED}uint32 width\nuint32 height\nstring encoding\nuint32 step\nuint8[] data\n"
    ),
    "CameraCalibration": _Equivalent(
        CAMERA_INFO,
        _camera_info,
        f"{_STAMPED}uint32 width\nuint32 height\nstring distortion_model\nfloat64[] d\nfloat64[9] k\nfloat64[9] r\n"
        "float64[12] p\n",
    ),
    "FrameTransform": _Equivalent(
        _TF,
        lambda message: SimpleNamespace(transforms=[_transform(message)]),
        "builtin_interfaces/Time timestamp\nstring parent_frame_id\nstring child_frame_id\n"
        "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n",
    ),
    "FrameTransforms": _Equivalent(
        _TF,
        lambda message: SimpleNamespace(transforms=[_transform(each) for each in message.transforms]),
        "foxglove_msgs/FrameTransform[] transforms",
    ),
    POSE_IN_FRAME: _Equivalent("geometry_msgs/msg/PoseStamped", _pose, f"{_STAMPED}geometry_msgs/Pose pose\n"),
}
"""The message of ROS that each Foxglove message stands for."""

_PACKETS = {
    True: "std_msgs/Header header\nuint8[] data\nint32 width\nint32 height\nstring encoding\nuint64 pts\nuint8 flags\n",
    False: (
        "std_msgs/Header header\nint32 width\nint32 height\nstring encoding\nuint64 pts\nuint8 flags\n"
        "bool is_bigendian\nuint8[] data\n"
    ),
}
"""Definitions of FFMPEGPacket, which differ between ROS 1 and ROS 2."""
