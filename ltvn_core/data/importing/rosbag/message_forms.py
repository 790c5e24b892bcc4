"""Converts messages of other makers to equivalent ROS messages, so that one reader serves all of them.

Owns the table of equivalent types: Foxglove's in protobuf, in JSON and as ROS messages, and video packets. Foxglove's
schemas have public and fixed field numbers and names; a schema in the file is never read. A result has the fields of
the ROS message, but need not be of its class.
"""

import base64
import struct
from collections.abc import Callable
from enum import Enum, auto
from types import SimpleNamespace
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from rosbags.interfaces import Connection, ConnectionExtRosbag2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from ltvn_core.data.importing.rosbag.video_stream import as_video
from ltvn_core.protobuf_fields import Field, read_fields
from ltvn_core.robots.ros2.ros_cameras import CAMERA_INFO
from ltvn_core.robots.ros2.ros_images import COMPRESSED_IMAGE, IMAGE
from ltvn_core.structured_text import parse_json

PREFIX = "foxglove."
"""Prefix of the name of a Foxglove schema in an MCAP file."""
PROTOBUF = "protobuf"
JSON = "json"
_MOST_FIELDS = 100_000
"""Largest number of fields of one message, with those of nested messages; a robot has a few hundred frames."""
_MOST_JSON_BYTES = 2**26
"""Largest size of a JSON message in bytes; parsed, it takes twenty times as much memory. A 4K image in base64 has 33
MB."""
CDR = "cdr"
ROS1 = "ros1"
POSE_IN_FRAME = "PoseInFrame"
_POSE_STAMPED = "geometry_msgs/msg/PoseStamped"
_TF = "tf2_msgs/msg/TFMessage"
_PACKET = "ffmpeg_image_transport_msgs/msg/FFMPEGPacket"
_ROS_FOXGLOVE = "foxglove_msgs/msg/"
_Convert = Callable[[Any], Any]


class _Kind(Enum):
    TEXT = auto()
    BYTES = auto()
    INTEGER = auto()
    DOUBLE = auto()
    DOUBLES = auto()
    MESSAGE = auto()
    MESSAGES = auto()


class SchemaField(NamedTuple):
    """A field of a schema."""

    number: int
    """Field number in protobuf."""
    name: str
    """Field name in the ROS message."""
    kind: _Kind
    inner: "Schema" = ()
    """Fields of the nested message; empty if it is none."""
    json_name: str = ""
    """Field name in JSON, if it differs."""


Schema: TypeAlias = tuple[SchemaField, ...]

_VECTOR: Schema = tuple(SchemaField(number, name, _Kind.DOUBLE) for number, name in enumerate("xyz", 1))

_QUATERNION: Schema = tuple(SchemaField(number, name, _Kind.DOUBLE) for number, name in enumerate("xyzw", 1))

_TIME: Schema = (SchemaField(1, "sec", _Kind.INTEGER), SchemaField(2, "nanosec", _Kind.INTEGER, (), "nsec"))

_STAMP = SchemaField(1, "timestamp", _Kind.MESSAGE, _TIME)

_POSE: Schema = (
    SchemaField(1, "position", _Kind.MESSAGE, _VECTOR),
    SchemaField(2, "orientation", _Kind.MESSAGE, _QUATERNION),
)

_FRAME_TRANSFORM: Schema = (
    _STAMP,
    SchemaField(2, "parent_frame_id", _Kind.TEXT),
    SchemaField(3, "child_frame_id", _Kind.TEXT),
    SchemaField(4, "translation", _Kind.MESSAGE, _VECTOR),
    SchemaField(5, "rotation", _Kind.MESSAGE, _QUATERNION),
)

SCHEMAS: dict[str, Schema] = {
    "CompressedImage": (
        _STAMP,
        SchemaField(2, "data", _Kind.BYTES),
        SchemaField(3, "format", _Kind.TEXT),
        SchemaField(4, "frame_id", _Kind.TEXT),
    ),
    "CompressedVideo": (
        _STAMP,
        SchemaField(2, "frame_id", _Kind.TEXT),
        SchemaField(3, "data", _Kind.BYTES),
        SchemaField(4, "format", _Kind.TEXT),
    ),
    "RawImage": (
        _STAMP,
        SchemaField(2, "width", _Kind.INTEGER),
        SchemaField(3, "height", _Kind.INTEGER),
        SchemaField(4, "encoding", _Kind.TEXT),
        SchemaField(5, "step", _Kind.INTEGER),
        SchemaField(6, "data", _Kind.BYTES),
        SchemaField(7, "frame_id", _Kind.TEXT),
    ),
    "CameraCalibration": (
        _STAMP,
        SchemaField(2, "width", _Kind.INTEGER),
        SchemaField(3, "height", _Kind.INTEGER),
        SchemaField(4, "distortion_model", _Kind.TEXT),
        *(SchemaField(number, name, _Kind.DOUBLES, (), name.upper()) for number, name in enumerate("dkrp", 5)),
        SchemaField(9, "frame_id", _Kind.TEXT),
    ),
    "FrameTransform": _FRAME_TRANSFORM,
    "FrameTransforms": (SchemaField(1, "transforms", _Kind.MESSAGES, _FRAME_TRANSFORM),),
    "PoseInFrame": (
        _STAMP,
        SchemaField(2, "frame_id", _Kind.TEXT),
        SchemaField(3, "pose", _Kind.MESSAGE, _POSE),
    ),
}
"""Fields of each supported schema, by its name."""


def read_message(data: bytes, encoding: str, name: str) -> SimpleNamespace:
    """Return the fields of a message by their names in ROS; missing fields are 0 or empty.

    Args:
        data: The encoded message.
        encoding: `PROTOBUF` or `JSON`.
        name: A key of `SCHEMAS`.

    Raises:
        ValueError: The data is not a message of this schema.
        TypeError: A JSON field has the wrong type.
    """
    if encoding == PROTOBUF:
        return _ProtobufReader().read(data, SCHEMAS[name])
    if len(data) > _MOST_JSON_BYTES:
        raise ValueError(f"{len(data):,} bytes of JSON, but at most {_MOST_JSON_BYTES:,} are read")
    return _json_fields(parse_json(data), SCHEMAS[name])


class _ProtobufReader:
    """Reads one message, and counts its fields."""

    def __init__(self) -> None:
        self._count = 0

    def read(self, data: bytes, schema: Schema) -> SimpleNamespace:
        known = {each.number: each for each in schema}
        found: dict[int, list[Field]] = {}
        for field in read_fields(data):
            self._count += 1
            if self._count > _MOST_FIELDS:
                raise ValueError(f"it has more than {_MOST_FIELDS:,} fields")
            if field.number in known:
                found.setdefault(field.number, []).append(field)
        return SimpleNamespace(
            **{each.name: self._value(each, [field.value for field in found.get(each.number, ())]) for each in schema}
        )

    def _value(self, field: SchemaField, values: list[int | bytes]) -> Any:
        match field.kind:
            case _Kind.INTEGER:
                return _integer(values[-1]) if values else 0
            case _Kind.DOUBLE:
                return struct.unpack("<d", _bytes(values[-1]))[0] if values else 0.0
            case _Kind.DOUBLES:  # Packed, or one value at a time.
                return np.frombuffer(b"".join(map(_bytes, values)), "<f8")
            case _Kind.TEXT:
                return _bytes(values[-1]).decode(errors="replace") if values else ""
            case _Kind.BYTES:
                return np.frombuffer(_bytes(values[-1]) if values else b"", np.uint8)
            case _Kind.MESSAGE:  # Protobuf may split one message into parts, which must be joined.
                return self.read(b"".join(map(_bytes, values)), field.inner)
            case _Kind.MESSAGES:
                return [self.read(_bytes(value), field.inner) for value in values]


def _integer(value: int | bytes) -> int:
    return value if isinstance(value, int) else int.from_bytes(value, "little")


def _bytes(value: int | bytes) -> bytes:
    if isinstance(value, int):
        raise ValueError("there is a number where the schema has bytes")
    return value


def _json_fields(said: Any, schema: Schema) -> SimpleNamespace:
    if not isinstance(said, dict):
        raise ValueError(f"expected a JSON object, got {type(said).__name__}")
    return SimpleNamespace(**{each.name: _json_value(each, said.get(each.json_name or each.name)) for each in schema})


def _json_value(field: SchemaField, said: Any) -> Any:
    match field.kind:
        case _Kind.INTEGER:
            return int(said or 0)
        case _Kind.DOUBLE:
            return float(said or 0)
        case _Kind.DOUBLES:
            return np.asarray([float(number) for number in said or ()], np.float64)
        case _Kind.TEXT:
            return str(said or "")
        case _Kind.BYTES:
            return np.frombuffer(base64.b64decode(said or ""), np.uint8)
        case _Kind.MESSAGE:
            return _json_fields(said or {}, field.inner)
        case _Kind.MESSAGES:
            return [_json_fields(each, field.inner) for each in said or ()]


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
        prefix = PREFIX if self.encoding in (PROTOBUF, JSON) else _ROS_FOXGLOVE
        name = self.schema.removeprefix(prefix) if self.schema.startswith(prefix) else ""
        return name if name in SCHEMAS else ""

    @property
    def msgtype(self) -> str | None:
        """ROS message type as which the messages are read; None if they are not supported."""
        if self.foxglove:
            return _FOXGLOVE[self.foxglove][0]
        if self.encoding not in (CDR, ROS1):
            return None
        return COMPRESSED_IMAGE if self.schema == _PACKET else self.schema


class MessageReader:
    """Decodes the messages of one bag."""

    def __init__(self, *, ros1: bool) -> None:
        """Load the message types of ROS 1 or ROS 2."""
        self._store = _typestore(ros1=ros1)

    def read(self, data: bytes, written: Written) -> Any:
        """Return a message in ROS's form. Raises any exception for a damaged message, because the library trusts its
        lengths."""
        if written.encoding in (PROTOBUF, JSON):
            return _FOXGLOVE[written.foxglove][1](read_message(data, written.encoding, written.foxglove))
        read = self._store.deserialize_ros1 if written.encoding == ROS1 else self._store.deserialize_cdr
        message = read(data, written.schema)
        if written.foxglove:
            return _FOXGLOVE[written.foxglove][1](message)
        return _packet(message) if written.schema == _PACKET else message


def _header(message: Any, frame: str) -> Any:
    return SimpleNamespace(stamp=message.timestamp, frame_id=frame)


def _packet(message: Any) -> Any:
    return SimpleNamespace(header=message.header, format=as_video(message.encoding), data=message.data)


def _compressed(message: Any) -> Any:
    return SimpleNamespace(header=_header(message, message.frame_id), format=message.format, data=message.data)


def _video(message: Any) -> Any:
    return SimpleNamespace(
        header=_header(message, message.frame_id), format=as_video(message.format), data=message.data
    )


def _image(message: Any) -> Any:
    return SimpleNamespace(
        header=_header(message, message.frame_id),
        height=message.height,
        width=message.width,
        encoding=message.encoding,
        is_bigendian=0,
        step=message.step,
        data=message.data,
    )


def _camera_info(message: Any) -> Any:
    """Return a CameraInfo without a region of interest. Raises ValueError for matrices of a wrong size."""
    # ROS 1 uses capital letters for these fields.
    d, k, p = (np.asarray(getattr(message, name, getattr(message, name.upper(), ())), np.float64) for name in "dkp")
    if k.size not in (0, 9) or p.size not in (0, 12):
        raise ValueError(f"K has {k.size} numbers and P has {p.size}, expected 9 and 12")
    return SimpleNamespace(
        header=_header(message, message.frame_id),
        width=message.width,
        height=message.height,
        distortion_model=message.distortion_model,
        d=d,
        k=k,
        p=p,
        roi=SimpleNamespace(x_offset=0, y_offset=0, width=0, height=0),
    )


def _transform(message: Any) -> Any:
    return SimpleNamespace(
        header=_header(message, message.parent_frame_id),
        child_frame_id=message.child_frame_id,
        transform=SimpleNamespace(translation=message.translation, rotation=_turn(message.rotation)),
    )


def _transforms(message: Any) -> Any:
    return SimpleNamespace(transforms=[_transform(each) for each in message.transforms])


def _pose(message: Any) -> Any:
    pose = SimpleNamespace(position=message.pose.position, orientation=_turn(message.pose.orientation))
    return SimpleNamespace(header=_header(message, message.frame_id), pose=pose)


def _turn(said: Any) -> Any:
    """Return a rotation; the identity if all fields are 0, because protobuf omits such fields."""
    return said if any((said.x, said.y, said.z, said.w)) else SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0)


_FOXGLOVE: dict[str, tuple[str, _Convert]] = {
    "CompressedImage": (COMPRESSED_IMAGE, _compressed),
    "CompressedVideo": (COMPRESSED_IMAGE, _video),
    "RawImage": (IMAGE, _image),
    "CameraCalibration": (CAMERA_INFO, _camera_info),
    "FrameTransform": (_TF, lambda message: SimpleNamespace(transforms=[_transform(message)])),
    "FrameTransforms": (_TF, _transforms),
    POSE_IN_FRAME: (_POSE_STAMPED, _pose),
}
"""ROS message type and conversion of each Foxglove schema."""

_TRANSFORMS = "geometry_msgs/TransformStamped[] transforms"

_STAMPED = "builtin_interfaces/Time timestamp\nstring frame_id\n"

_MATRICES = "float64[] d\nfloat64[9] k\nfloat64[9] r\nfloat64[12] p\n"

_DEFINITIONS = {
    _ROS_FOXGLOVE + "CompressedImage": _STAMPED + "uint8[] data\nstring format\n",
    _ROS_FOXGLOVE + "CompressedVideo": _STAMPED + "uint8[] data\nstring format\n",
    _ROS_FOXGLOVE + "RawImage": _STAMPED + "uint32 width\nuint32 height\nstring encoding\nuint32 step\nuint8[] data\n",
    _ROS_FOXGLOVE + "CameraCalibration": _STAMPED
    + "uint32 width\nuint32 height\nstring distortion_model\n"
    + _MATRICES,
    _ROS_FOXGLOVE + "FrameTransform": (
        "builtin_interfaces/Time timestamp\nstring parent_frame_id\nstring child_frame_id\n"
        "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n"
    ),
    _ROS_FOXGLOVE + "FrameTransforms": "foxglove_msgs/FrameTransform[] transforms",
    _ROS_FOXGLOVE + POSE_IN_FRAME: _STAMPED + "geometry_msgs/Pose pose\n",
}

_PACKETS = {
    True: "std_msgs/Header header\nuint8[] data\nint32 width\nint32 height\nstring encoding\nuint64 pts\nuint8 flags\n",
    False: (
        "std_msgs/Header header\nint32 width\nint32 height\nstring encoding\nuint64 pts\nuint8 flags\n"
        "bool is_bigendian\nuint8[] data\n"
    ),
}
"""Definitions of FFMPEGPacket, which differ between ROS 1 and ROS 2."""


def _typestore(*, ros1: bool) -> Typestore:
    """Return the ROS message types, with the supported types of other makers."""
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.LATEST)
    added = {**_DEFINITIONS, _PACKET: _PACKETS[ros1]}
    if ros1:
        added |= dict.fromkeys((_TF, "tf/msg/tfMessage"), _TRANSFORMS)
    for name, definition in added.items():
        store.register(get_types_from_msg(definition, name))
    return store
