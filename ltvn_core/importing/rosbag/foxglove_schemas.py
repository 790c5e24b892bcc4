"""Foxglove's schemas of images, cameras, frames and poses, read from protobuf and from JSON.

Owns the numbers and names of their fields, which are public and fixed; a schema that lies in a file is never read.
"""

import base64
import struct
from enum import Enum, auto
from types import SimpleNamespace
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from ltvn_core.protobuf_fields import Field, read_fields
from ltvn_core.structured_text import parse_json

PREFIX = "foxglove."
"""Before the name of a schema in an MCAP file."""
PROTOBUF, JSON = "protobuf", "json"
_MOST_FIELDS = 100_000
"""Fields of one message, those of its parts included; a robot has a few hundred frames."""
_MOST_JSON_BYTES = 2**26
"""Of text, which takes twenty times as much memory when it is read; an image of 4K in base64 has 33 MB."""


class _Kind(Enum):
    TEXT = auto()
    BYTES = auto()
    INTEGER = auto()
    DOUBLE = auto()
    DOUBLES = auto()
    MESSAGE = auto()
    MESSAGES = auto()


class SchemaField(NamedTuple):
    """A field of a message."""

    number: int
    """Its number in protobuf."""
    name: str
    """Its name in ROS's version of the message."""
    kind: _Kind
    inner: "Schema" = ()
    """The fields of the message that it holds."""
    json_name: str = ""
    """Its name in JSON, where that is another."""


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
"""Name -> fields, for the schemas that say something of a drive."""


def read_message(data: bytes, encoding: str, name: str) -> SimpleNamespace:
    """Return the fields of a message by their names in ROS; what a message leaves out is 0 or empty.

    Args:
        data: The message as it lies in the file.
        encoding: `PROTOBUF` or `JSON`.
        name: A key of `SCHEMAS`.

    Raises:
        ValueError: It is no such message.
        TypeError: A field of JSON is of another type.
    """
    if encoding == PROTOBUF:
        return _ProtobufReader().read(data, SCHEMAS[name])
    if len(data) > _MOST_JSON_BYTES:
        raise ValueError(f"{len(data):,} bytes of JSON, where {_MOST_JSON_BYTES:,} are the most that is read")
    return _json_fields(parse_json(data), SCHEMAS[name])


class _ProtobufReader:
    """Reads one message and counts its fields."""

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
            case _Kind.DOUBLES:  # Packed together or one by one.
                return np.frombuffer(b"".join(map(_bytes, values)), "<f8")
            case _Kind.TEXT:
                return _bytes(values[-1]).decode(errors="replace") if values else ""
            case _Kind.BYTES:
                return np.frombuffer(_bytes(values[-1]) if values else b"", np.uint8)
            case _Kind.MESSAGE:  # Parts of one message that came apart are joined.
                return self.read(b"".join(map(_bytes, values)), field.inner)
            case _Kind.MESSAGES:
                return [self.read(_bytes(value), field.inner) for value in values]


def _integer(value: int | bytes) -> int:
    return value if isinstance(value, int) else int.from_bytes(value, "little")


def _bytes(value: int | bytes) -> bytes:
    if isinstance(value, int):
        raise ValueError("a number stands where the schema has bytes")
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
