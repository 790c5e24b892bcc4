"""Writes a drive as a ROS 2 bag in MCAP, like the recording of a robot with a depth camera.

Owns the names of topics and frames: the robot is `base_footprint`, the camera `camera_color_optical_frame`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore
from scipy.spatial.transform import Rotation

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.data.exporting.exported_drive import CameraPlace, ExportedDrive, ExportedFrame
from ltvn_core.robots.ros2.ros_messages import distortion_model
from ltvn_core.types import Pose

COLOURS = "/camera/color/image_raw/compressed"
COLOUR_CAMERA = "/camera/color/camera_info"
DEPTH = "/camera/aligned_depth_to_color/image_raw"
ODOMETRY = "/odom"
TRUTH = "/ground_truth/pose"

_ROBOT = "base_footprint"
_WORLD = "odom"
_TRUE_WORLD = "map"
_CAMERA = "camera_color_optical_frame"
_STATIC = "/tf_static"
_BAG_VERSION = 8
"""Newest version of bag metadata that ROS 2 Humble reads; from version 9 on, QoS profiles are lists, which it cannot
parse."""
_UNLIMITED = QosTime(0, 0)
_LATCHED = Qos(
    history=QosHistory.KEEP_LAST,
    depth=1,
    reliability=QosReliability.RELIABLE,
    durability=QosDurability.TRANSIENT_LOCAL,
    deadline=_UNLIMITED,
    lifespan=_UNLIMITED,
    liveliness=QosLiveliness.AUTOMATIC,
    liveliness_lease_duration=_UNLIMITED,
    avoid_ros_namespace_conventions=False,
)
"""QoS with which ROS publishes `/tf_static`; a subscriber that asks for "transient local" gets nothing without it."""


def write_ros_bag(drive: ExportedDrive, folder: Path) -> None:
    """Write a new folder with the bag. Raises OSError."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    writer = Writer(folder, version=_BAG_VERSION, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)  # zstd shrinks depth to a third.
    with writer:
        messages = _Messages(writer, store)
        is_first = True
        for frame in drive.frames():
            if is_first or drive.turns_camera:
                topic = "/tf" if drive.turns_camera else _STATIC
                messages.write_transform(topic, _ROBOT, _CAMERA, drive.on_robot(frame.tilt), frame.stamp)
            is_first = False
            _write_frame(messages, drive.camera, frame)


def _write_frame(messages: "_Messages", camera: CameraModel, frame: ExportedFrame) -> None:
    messages.write_odometry(frame.odometry, frame.stamp)
    messages.write_transform("/tf", _WORLD, _ROBOT, _planar(frame.odometry), frame.stamp)
    if frame.truth is not None:
        messages.write_pose(frame.truth, frame.stamp)
    messages.write_camera(camera, frame.stamp)
    messages.write_colours(frame.jpeg, frame.stamp)
    if (depth := frame.depth_millimetres) is not None:
        messages.write_depth(depth, frame.stamp)


def _planar(pose: Pose) -> CameraPlace:
    x, y, yaw = pose
    return CameraPlace(np.array([x, y, 0.0]), Rotation.from_euler("z", yaw))


@dataclass
class _Messages:
    """Writes each message to its topic."""

    writer: Writer
    store: Typestore
    connections: dict[str, Any] = field(default_factory=dict)

    def write_odometry(self, pose: Pose, stamp: float) -> None:
        zero = self._make("geometry_msgs/msg/Vector3", _lettered("xyz", np.zeros(3)))
        twist = self._make("geometry_msgs/msg/Twist", {"linear": zero, "angular": zero})
        unknown = np.zeros(36)
        fields = {
            "header": self._header(stamp, _WORLD),
            "child_frame_id": _ROBOT,
            "pose": self._make(
                "geometry_msgs/msg/PoseWithCovariance", {"pose": self._pose(_planar(pose)), "covariance": unknown}
            ),
            "twist": self._make("geometry_msgs/msg/TwistWithCovariance", {"twist": twist, "covariance": unknown}),
        }
        self._write(ODOMETRY, "nav_msgs/msg/Odometry", fields, stamp)

    def write_pose(self, pose: Pose, stamp: float) -> None:
        fields = {"header": self._header(stamp, _TRUE_WORLD), "pose": self._pose(_planar(pose))}
        self._write(TRUTH, "geometry_msgs/msg/PoseStamped", fields, stamp)

    def write_transform(self, topic: str, parent: str, child: str, place: CameraPlace, stamp: float) -> None:
        fields = {
            "translation": self._make("geometry_msgs/msg/Vector3", _lettered("xyz", place.position)),
            "rotation": self._make("geometry_msgs/msg/Quaternion", _lettered("xyzw", place.rotation.as_quat())),
        }
        stamped = self._make(
            "geometry_msgs/msg/TransformStamped",
            {
                "header": self._header(stamp, parent),
                "child_frame_id": child,
                "transform": self._make("geometry_msgs/msg/Transform", fields),
            },
        )
        self._write(topic, "tf2_msgs/msg/TFMessage", {"transforms": [stamped]}, stamp)

    def write_camera(self, camera: CameraModel, stamp: float) -> None:
        k = [camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1]
        p = [camera.fx, 0, camera.cx, 0, 0, camera.fy, camera.cy, 0, 0, 0, 1, 0]
        nothing = {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False}
        fields = {
            "header": self._header(stamp, _CAMERA),
            "height": camera.height,
            "width": camera.width,
            "distortion_model": distortion_model(camera),
            "d": np.array(camera.distortion or (0.0,) * 5, np.float64),
            "k": np.array(k, np.float64),
            "r": np.eye(3).ravel(),
            "p": np.array(p, np.float64),
            "binning_x": 0,
            "binning_y": 0,
            "roi": self._make("sensor_msgs/msg/RegionOfInterest", nothing),
        }
        self._write(COLOUR_CAMERA, "sensor_msgs/msg/CameraInfo", fields, stamp)

    def write_colours(self, jpeg: bytes, stamp: float) -> None:
        fields = {
            "header": self._header(stamp, _CAMERA),
            "format": "rgb8; jpeg compressed bgr8",
            "data": np.frombuffer(jpeg, np.uint8),
        }
        self._write(COLOURS, "sensor_msgs/msg/CompressedImage", fields, stamp)

    def write_depth(self, millimetres: np.ndarray, stamp: float) -> None:
        fields = {
            "header": self._header(stamp, _CAMERA),
            "height": millimetres.shape[0],
            "width": millimetres.shape[1],
            "encoding": "16UC1",
            "is_bigendian": 0,
            "step": 2 * millimetres.shape[1],
            "data": np.ascontiguousarray(millimetres.astype("<u2")).view(np.uint8).ravel(),
        }
        self._write(DEPTH, "sensor_msgs/msg/Image", fields, stamp)

    def _pose(self, place: CameraPlace) -> Any:
        position = self._make("geometry_msgs/msg/Point", _lettered("xyz", place.position))
        turn = self._make("geometry_msgs/msg/Quaternion", _lettered("xyzw", place.rotation.as_quat()))
        return self._make("geometry_msgs/msg/Pose", {"position": position, "orientation": turn})

    def _header(self, stamp: float, frame: str) -> Any:
        seconds, nanoseconds = divmod(round(stamp * 1e9), 10**9)
        time = self._make("builtin_interfaces/msg/Time", {"sec": seconds, "nanosec": nanoseconds})
        return self._make("std_msgs/msg/Header", {"stamp": time, "frame_id": frame})

    def _make(self, name: str, fields: Mapping[str, Any]) -> Any:
        return self.store.types[name](**fields)

    def _write(self, topic: str, name: str, fields: Mapping[str, Any], stamp: float) -> None:
        if topic not in self.connections:
            self.connections[topic] = self.writer.add_connection(
                topic, name, typestore=self.store, offered_qos_profiles=[_LATCHED] if topic == _STATIC else ()
            )
        data = self.store.serialize_cdr(self._make(name, fields), name)
        self.writer.write(self.connections[topic], round(stamp * 1e9), data)


def _lettered(letters: str, values: ArrayLike) -> dict[str, float]:
    return dict(zip(letters, map(float, np.asarray(values)), strict=True))
