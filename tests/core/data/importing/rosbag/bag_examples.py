"""Small bags as other people's robots record them, written by the library `rosbags`."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.spatial.transform import Rotation

BEGIN_S = 1_700_000_000.0
WIDTH, HEIGHT = 64, 48
FOCAL = 55.0
OPTICAL = Rotation.from_matrix([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])
"""The optical frame of a camera that looks straight ahead, in the robot's frame."""
COLOUR_FRAME = "camera_color_optical_frame"


class Place(NamedTuple):
    """A pose in space."""

    xyz: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn: Rotation = Rotation.identity()


def planar(x: float, y: float, yaw: float) -> Place:
    return Place((x, y, 0.0), Rotation.from_euler("z", yaw))


def mounted(x: float = 0.1, height: float = 0.6, pitch_down: float = 0.2, roll: float = 0.0) -> Place:
    """Where a camera is on `base_footprint` that looks down a little."""
    return Place((x, 0.0, height), Rotation.from_euler("ZYX", [0.0, pitch_down, roll]) * OPTICAL)


def colours(number: int) -> NDArray[np.uint8]:
    """A picture that differs from each other one, smooth enough for JPEG."""
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    return np.stack([rows * 4, columns * 3, np.full_like(rows, 20 * number)], axis=-1).astype(np.uint8)


def metres(number: int) -> NDArray[np.float32]:
    return np.full((HEIGHT, WIDTH), 1.0 + 0.125 * number, np.float32)


@dataclass
class BagBuilder:
    """Writes messages to a bag of ROS 1 or 2."""

    writer: Any
    store: Any
    ros1: bool = False
    connections: dict[str, Any] = field(default_factory=dict)

    def make(self, name: str, **fields: Any) -> Any:
        return self.store.types[name](**fields)

    def header(self, stamp: float, frame: str) -> Any:
        nanoseconds = round(stamp * 1e9)
        time = self.make("builtin_interfaces/msg/Time", sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)
        first = {"seq": 0} if self.ros1 else {}
        return self.make("std_msgs/msg/Header", **first, stamp=time, frame_id=frame)

    def write(self, topic: str, message: Any, log_s: float) -> None:
        kind = message.__msgtype__
        if topic not in self.connections:
            self.connections[topic] = self.writer.add_connection(topic, kind, typestore=self.store)
        data = self.store.serialize_ros1(message, kind) if self.ros1 else self.store.serialize_cdr(message, kind)
        self.writer.write(self.connections[topic], round(log_s * 1e9), data)

    def image(
        self, topic: str, pixels: NDArray, encoding: str, stamp: float, frame: str = COLOUR_FRAME, log_s: float = 0.0
    ) -> None:
        message = self.make(
            "sensor_msgs/msg/Image",
            header=self.header(stamp, frame),
            height=pixels.shape[0],
            width=pixels.shape[1],
            encoding=encoding,
            is_bigendian=0,
            step=pixels.strides[0],
            data=np.ascontiguousarray(pixels).view(np.uint8).ravel(),
        )
        self.write(topic, message, log_s or stamp)

    def compressed(self, topic: str, data: bytes, form: str, stamp: float, frame: str = COLOUR_FRAME) -> None:
        message = self.make(
            "sensor_msgs/msg/CompressedImage",
            header=self.header(stamp, frame),
            format=form,
            data=np.frombuffer(data, np.uint8),
        )
        self.write(topic, message, stamp)

    def camera_info(
        self,
        topic: str,
        stamp: float,
        *,
        frame: str = COLOUR_FRAME,
        model: str = "plumb_bob",
        d: tuple[float, ...] = (0.0,) * 5,
        focal: float = FOCAL,
        centre: tuple[float, float] = ((WIDTH - 1) / 2, (HEIGHT - 1) / 2),
        size: tuple[int, int] = (WIDTH, HEIGHT),
        has_k: bool = True,
        has_p: bool = True,
    ) -> None:
        cx, cy = centre
        k = np.array([focal, 0, cx, 0, focal, cy, 0, 0, 1]) * has_k
        p = np.array([focal, 0, cx, 0, 0, focal, cy, 0, 0, 0, 1, 0]) * has_p
        numbers = {"d": d, "k": k, "r": np.eye(3).ravel(), "p": p}
        arrays = {(name.upper() if self.ros1 else name): np.array(value, float) for name, value in numbers.items()}
        roi = self.make("sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
        message = self.make(
            "sensor_msgs/msg/CameraInfo",
            header=self.header(stamp, frame),
            height=size[1],
            width=size[0],
            distortion_model=model,
            binning_x=0,
            binning_y=0,
            roi=roi,
            **arrays,
        )
        self.write(topic, message, stamp)

    def odometry(
        self,
        topic: str,
        place: Place,
        stamp: float,
        *,
        parent: str = "odom",
        child: str = "base_footprint",
        log_s: float = 0.0,
        variance: float = 0.0,
        is_null: bool = False,
    ) -> None:
        pose = self._pose(place)
        if is_null:
            pose.orientation = self.make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=0.0)
        zero = self.make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
        message = self.make(
            "nav_msgs/msg/Odometry",
            header=self.header(stamp, parent),
            child_frame_id=child,
            pose=self.make(
                "geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=np.diag([variance] * 6).ravel()
            ),
            twist=self.make(
                "geometry_msgs/msg/TwistWithCovariance",
                twist=self.make("geometry_msgs/msg/Twist", linear=zero, angular=zero),
                covariance=np.zeros(36),
            ),
        )
        self.write(topic, message, log_s or stamp)

    def pose(self, topic: str, place: Place, stamp: float) -> None:
        message = self.make("geometry_msgs/msg/PoseStamped", header=self.header(stamp, "map"), pose=self._pose(place))
        self.write(topic, message, stamp)

    def transforms(self, topic: str, edges: dict[tuple[str, str], Place], stamp: float, log_s: float = 0.0) -> None:
        stamped = [
            self.make(
                "geometry_msgs/msg/TransformStamped",
                header=self.header(stamp, parent),
                child_frame_id=child,
                transform=self.make(
                    "geometry_msgs/msg/Transform",
                    translation=self.make("geometry_msgs/msg/Vector3", **_named("xyz", place.xyz)),
                    rotation=self._quaternion(place),
                ),
            )
            for (parent, child), place in edges.items()
        ]
        self.write(topic, self.make("tf2_msgs/msg/TFMessage", transforms=stamped), log_s or stamp)

    def _pose(self, place: Place) -> Any:
        return self.make(
            "geometry_msgs/msg/Pose",
            position=self.make("geometry_msgs/msg/Point", **_named("xyz", place.xyz)),
            orientation=self._quaternion(place),
        )

    def _quaternion(self, place: Place) -> Any:
        return self.make("geometry_msgs/msg/Quaternion", **_named("xyzw", place.turn.as_quat()))


def _named(letters: str, values: Any) -> dict[str, float]:
    return dict(zip(letters, map(float, values), strict=True))


@contextmanager
def bag(path: Path, kind: str = "mcap", compression: str = "") -> Iterator[BagBuilder]:
    """Yield a builder of a bag: `mcap` and `sqlite3` are folders of ROS 2, `bag` is a file of ROS 1.

    ROS 1 compresses by LZ4 or BZ2; ROS 2 by FILE, MESSAGE or STORAGE.
    """
    if kind == "bag":
        store = get_typestore(Stores.ROS1_NOETIC)
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage"))
        writer1 = Writer1(path)
        if compression:
            writer1.set_compression(Writer1.CompressionFormat[compression])
        with writer1:
            yield BagBuilder(writer1, store, ros1=True)
    else:
        storage = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
        writer2 = Writer2(path, version=9, storage_plugin=storage)
        if compression:
            writer2.set_compression(CompressionMode[compression], CompressionFormat.ZSTD)
        with writer2:
            yield BagBuilder(writer2, get_typestore(Stores.ROS2_HUMBLE))


def straight_drive(path: Path, kind: str = "mcap", frames: int = 6, compression: str = "") -> Path:
    """Write a drive as a robot with a RealSense records it: 10 cm a frame straight ahead, 5 frames a second."""
    with bag(path, kind, compression) as builder:
        builder.transforms("/tf_static", {("base_footprint", COLOUR_FRAME): mounted()}, BEGIN_S)
        builder.camera_info("/camera/color/camera_info", BEGIN_S)
        for tick in range(frames * 4 + 4):
            builder.odometry("/odom", planar(0.025 * tick, 0.0, 0.0), BEGIN_S + 0.05 * tick)
            if tick % 4 == 2 and tick // 4 < frames:
                number, stamp = tick // 4, BEGIN_S + 0.05 * tick
                builder.image("/camera/color/image_raw", colours(number), "rgb8", stamp)
                depth = np.round(metres(number) * 1000).astype(np.uint16)
                builder.image("/camera/aligned_depth_to_color/image_raw", depth, "16UC1", stamp)
    return path


def jpeg(pixels: NDArray[np.uint8]) -> bytes:
    return cv2.imencode(".jpg", pixels[..., ::-1], (cv2.IMWRITE_JPEG_QUALITY, 98))[1].tobytes()


def png(pixels: NDArray) -> bytes:
    return cv2.imencode(".png", pixels)[1].tobytes()
