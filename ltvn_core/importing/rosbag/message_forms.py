"""Messages of other makers as the messages of ROS that say the same, so that one reader serves them all.

Owns the table of types that count as another: Foxglove's, in protobuf, in JSON and as messages of ROS, and packets of
video. What comes out has the fields of ROS's message and need not be of its class.
"""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from rosbags.interfaces import Connection, ConnectionExtRosbag2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from ltvn_core.importing.rosbag.foxglove_schemas import JSON, PREFIX, PROTOBUF, SCHEMAS, read_message
from ltvn_core.importing.rosbag.video_formats import as_video
from ltvn_core.robots.ros2.ros_cameras import CAMERA_INFO
from ltvn_core.robots.ros2.ros_images import COMPRESSED_IMAGE, IMAGE

CDR, ROS1 = "cdr", "ros1"
POSE_IN_FRAME = "PoseInFrame"
_POSE_STAMPED = "geometry_msgs/msg/PoseStamped"
_TF = "tf2_msgs/msg/TFMessage"
_PACKET = "ffmpeg_image_transport_msgs/msg/FFMPEGPacket"
_ROS_FOXGLOVE = "foxglove_msgs/msg/"

_Convert = Callable[[Any], Any]


class Written(NamedTuple):
    """How the messages of a channel lie in the file."""

    encoding: str
    """`cdr`, `ros1`, `protobuf`, `json` or one that is not read."""
    schema: str
    """The name of their type, as the file has it."""

    @classmethod
    def of(cls, connection: Connection) -> "Written":
        """Return how a connection's messages are written."""
        extension = connection.ext
        encoding = extension.serialization_format if isinstance(extension, ConnectionExtRosbag2) else ROS1
        return cls(encoding or "unknown", connection.msgtype)

    @property
    def foxglove(self) -> str:
        """Name of the schema without its maker; "" where it is none of Foxglove's that are read."""
        prefix = PREFIX if self.encoding in (PROTOBUF, JSON) else _ROS_FOXGLOVE
        name = self.schema.removeprefix(prefix) if self.schema.startswith(prefix) else ""
        return name if name in SCHEMAS else ""

    @property
    def msgtype(self) -> str | None:
        """The type of ROS as which the messages are read; None where they are not."""
        if self.foxglove:
            return _FOXGLOVE[self.foxglove][0]
        if self.encoding not in (CDR, ROS1):
            return None
        return COMPRESSED_IMAGE if self.schema == _PACKET else self.schema


class MessageReader:
    """Decodes the messages of one bag."""

    def __init__(self, *, ros1: bool) -> None:
        """Prepare ROS's types: of ROS 1, or of ROS 2."""
        self._store = _typestore(ros1=ros1)

    def read(self, data: bytes, written: Written) -> Any:
        """Return a message in ROS's form. Raises any exception where it is damaged: the library trusts lengths."""
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
    """Return a CameraInfo of the whole image. Raises ValueError where matrices have other sizes than theirs."""
    # ROS 1 writes these large.
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
    """Return a turn, none where all is 0: protobuf does not send what nobody set."""
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
"""Foxglove's schema -> ROS's type, and the way there."""

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
"""FFMPEGPacket of ROS 1, and of ROS 2, which are not alike."""


def _typestore(*, ros1: bool) -> Typestore:
    """Return ROS's types with those of other makers that are read."""
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.LATEST)
    added = {**_DEFINITIONS, _PACKET: _PACKETS[ros1]}
    if ros1:
        added |= dict.fromkeys((_TF, "tf/msg/tfMessage"), _TRANSFORMS)
    for name, definition in added.items():
        store.register(get_types_from_msg(definition, name))
    return store
