"""Converts the toolkit's observations and commands to messages of ROS 2 and back; checks each incoming message.

Stamps are seconds on the robot's clock. Owns the names of frames. Images are decoded by `ros_images`.
"""

import math
from enum import Enum
from typing import Any, NamedTuple

import numpy as np

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.errors import RobotError
from ltvn_core.robots.ros2.ros_cameras import CAMERA_INFO
from ltvn_core.robots.ros2.ros_images import IMAGE
from ltvn_core.robots.ros2.topic_keys import BUMPER, DIAGNOSTIC, ODOMETRY, TRANSFORMS, TWIST, TWIST_STAMPED, type_store
from ltvn_core.types import ZERO_TWIST, Depth, Pose, Rgb, Twist

BASE_FRAME = "base_link"
ODOMETRY_FRAME = "odom"
CAMERA_FRAME = "camera_color_optical_frame"
_UNIT_QUATERNION_TOLERANCE = 0.01


class GuardState(Enum):
    """What the guard does with commands; the value is the level of its DiagnosticStatus."""

    FORWARDS = 0
    RESTRAINS = 1
    """It refuses forward motion, but not turning and backing up."""
    REFUSES = 2
    """It refuses all commands until it receives a stop."""


class GuardStatus(NamedTuple):
    """State of the guard with its reason, which is empty if it forwards commands."""

    state: GuardState
    reason: str = ""


def twist_message(twist: Twist, stamp_s: float | None) -> Any:
    """Return a velocity command: a TwistStamped if there is a stamp, else a Twist."""
    message = _make(TWIST, linear=_vector(twist.linear_m_s, 0.0, 0.0), angular=_vector(0.0, 0.0, twist.angular_rad_s))
    if stamp_s is None:
        return message
    return _make(TWIST_STAMPED, header=header(stamp_s, BASE_FRAME), twist=message)


def odometry_message(pose: Pose, speeds: Twist, stamp_s: float) -> Any:
    """Return an Odometry message with the robot's pose (3,) and speeds."""
    x, y, yaw = map(float, pose)
    place = _make(
        "geometry_msgs/msg/Pose", position=_make("geometry_msgs/msg/Point", x=x, y=y, z=0.0), orientation=_turn(yaw)
    )
    unknown = np.zeros(36)
    return _make(
        ODOMETRY,
        header=header(stamp_s, ODOMETRY_FRAME),
        child_frame_id=BASE_FRAME,
        pose=_make("geometry_msgs/msg/PoseWithCovariance", pose=place, covariance=unknown),
        twist=_make("geometry_msgs/msg/TwistWithCovariance", twist=twist_message(speeds, None), covariance=unknown),
    )


def transform_message(pose: Pose, stamp_s: float, parent: str, child: str) -> Any:
    """Return the robot's pose (3,) as a transform between two frames."""
    x, y, yaw = map(float, pose)
    place = _make("geometry_msgs/msg/Transform", translation=_vector(x, y, 0.0), rotation=_turn(yaw))
    head = header(stamp_s, parent)
    stamped = _make("geometry_msgs/msg/TransformStamped", header=head, child_frame_id=child, transform=place)
    return _make(TRANSFORMS, transforms=[stamped])


def image_message(pixels: Rgb | Depth, stamp_s: float) -> Any:
    """Return colours (H, W, 3) as rgb8, or depth (H, W) in metres as 32FC1."""
    rows = np.ascontiguousarray(pixels)
    return _make(
        IMAGE,
        header=header(stamp_s, CAMERA_FRAME),
        height=rows.shape[0],
        width=rows.shape[1],
        encoding="rgb8" if rows.ndim == 3 else "32FC1",
        is_bigendian=0,
        step=rows.strides[0],
        data=rows.view(np.uint8).ravel(),
    )


def camera_info_message(camera: CameraModel, stamp_s: float) -> Any:
    """Return a CameraInfo with the lens of a camera; the message does not contain the mounting."""
    k = [camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1]
    p = [camera.fx, 0, camera.cx, 0, 0, camera.fy, camera.cy, 0, 0, 0, 1, 0]
    region = {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False}
    return _make(
        CAMERA_INFO,
        header=header(stamp_s, CAMERA_FRAME),
        height=camera.height,
        width=camera.width,
        distortion_model=distortion_model(camera),
        d=np.array(camera.distortion or (0.0,) * 5, np.float64),
        k=np.array(k, np.float64),
        r=np.eye(3).ravel(),
        p=np.array(p, np.float64),
        binning_x=0,
        binning_y=0,
        roi=_make("sensor_msgs/msg/RegionOfInterest", **region),
    )


def header(stamp_s: float, frame: str) -> Any:
    """Return the header of a message."""
    # Seconds and nanoseconds are separate, because a float has too few digits for nanoseconds since 1970.
    seconds = math.floor(stamp_s)
    carry, nanoseconds = divmod(round((stamp_s - seconds) * 1e9), 10**9)
    return _make(
        "std_msgs/msg/Header",
        stamp=_make("builtin_interfaces/msg/Time", sec=seconds + carry, nanosec=nanoseconds),
        frame_id=frame,
    )


def distortion_model(camera: CameraModel) -> str:
    """Return ROS's name of a lens."""
    if camera.fisheye:
        return "equidistant"
    return "rational_polynomial" if len(camera.distortion) > 5 else "plumb_bob"


def read_stamp(message: Any, source: str) -> float:
    """Return the time in a message's header, in seconds. Raises RobotError."""
    stamp = message.header.stamp
    if stamp.sec < 0 or stamp.nanosec >= 10**9:
        raise RobotError(
            f"{source}: {stamp.sec} s and {stamp.nanosec} ns is not a valid time; is the robot's clock set?"
        )
    return stamp.sec + stamp.nanosec * 1e-9


def read_twist(message: Any, source: str) -> Twist:
    """Return the speeds in a Twist or TwistStamped.

    Raises RobotError if any of its six is not finite, or if it asks only for speeds that the robot cannot drive: such a
    command is no stop.
    """
    body = getattr(message, "twist", message)
    twist = Twist(float(body.linear.x), float(body.angular.z))
    every = [float(getattr(part, axis)) for part in (body.linear, body.angular) for axis in "xyz"]
    if not all(map(math.isfinite, every)):
        raise RobotError(
            f"{source}: a command must be two finite speeds, got {every[:3]} m/s and {every[3:]} rad/s; it is refused."
        )
    if any(every) and twist == ZERO_TWIST:
        raise RobotError(
            f"{source}: a command must be a speed ahead and a turn, got {every[:3]} m/s and {every[3:]} rad/s; it is "
            "refused."
        )
    return twist


def read_odometry(message: Any, source: str) -> Pose:
    """Return x, y, yaw (3,) of an Odometry. Raises RobotError if they are invalid."""
    return _planar(message.pose.pose.position, message.pose.pose.orientation, source)


def read_transform(message: Any, source: str) -> Pose:
    """Return x, y, yaw (3,) of a TransformStamped. Raises RobotError if they are invalid."""
    return _planar(message.transform.translation, message.transform.rotation, source)


def edges_of(message: Any) -> dict[tuple[str, str], Any]:
    """Return the TransformStamped of a TFMessage by parent and child, without the leading slash of older robots."""
    return {(each.header.frame_id.lstrip("/"), each.child_frame_id.lstrip("/")): each for each in message.transforms}


def bumper_message(*, pressed: bool) -> Any:
    """Return a Bool that tells whether the bumper is in contact."""
    return _make(BUMPER, data=pressed)


def guard_status_message(status: GuardStatus) -> Any:
    """Return the status of the guard as a DiagnosticStatus."""
    level = status.state.value
    return _make(DIAGNOSTIC, level=level, name="ltvn guard", message=status.reason, hardware_id="", values=[])


def read_guard_status(message: Any) -> GuardStatus:
    """Return the status in a DiagnosticStatus of the guard. Raises RobotError for an unknown level."""
    try:
        return GuardStatus(GuardState(int(message.level)), str(message.message))
    except ValueError as error:
        raise RobotError(f"The guard's status has level {message.level}; its levels are 0, 1 and 2.") from error


def _planar(place: Any, q: Any, source: str) -> Pose:
    length = math.hypot(q.x, q.y, q.z, q.w)
    if not (math.isfinite(place.x) and math.isfinite(place.y)):
        raise RobotError(f"{source}: odometry has x {place.x}, y {place.y}; both must be finite metres.")
    if not abs(length - 1.0) <= _UNIT_QUATERNION_TOLERANCE:
        raise RobotError(
            f"{source}: odometry's quaternion has length {length:g} instead of 1, so the heading is unknown."
        )
    yaw = math.atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z))
    return np.array([place.x, place.y, yaw])


def read_battery(message: Any) -> float | None:
    """Return the charge in a BatteryState, in [0, 1]; None if it is not measured, or in another unit."""
    share = float(message.percentage)
    return share if 0.0 <= share <= 1.0 else None  # In percent, every charge would seem full.


def _turn(yaw: float) -> Any:
    return _make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=math.sin(yaw / 2), w=math.cos(yaw / 2))


def _vector(x: float, y: float, z: float) -> Any:
    return _make("geometry_msgs/msg/Vector3", x=x, y=y, z=z)


def _make(name: str, /, **fields: Any) -> Any:
    return type_store().types[name](**fields)
