"""Types of ROS 2 messages: their names on the wire, their hashes, and their bytes (CDR).

Owns which edition of the types is spoken; `rosbags` knows the rest.
"""

from functools import cache
from typing import Any

from rosbags.serde.errors import SerdeError
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from ltvn_core.errors import RobotError

TWIST = "geometry_msgs/msg/Twist"
TWIST_STAMPED = "geometry_msgs/msg/TwistStamped"
ODOMETRY = "nav_msgs/msg/Odometry"
TRANSFORMS = "tf2_msgs/msg/TFMessage"
BATTERY = "sensor_msgs/msg/BatteryState"
BUMPER = "std_msgs/msg/Bool"

NO_HASH = "TypeHashNotSupported"
"""What robots with ROS 2 Humble say in place of a hash."""


@cache
def type_store() -> Typestore:
    """Return the types of ROS 2 Jazzy; those used here are the same in Humble, Kilted and Lyrical."""
    return get_typestore(Stores.ROS2_JAZZY)


@cache
def type_hash(name: str) -> str:
    """Return the RIHS01 hash of a type such as `geometry_msgs/msg/Twist`."""
    return type_store().hash_rihs01(name)


def dds_name(name: str) -> str:
    """Return the name of a type on the wire: `geometry_msgs::msg::dds_::Twist_`."""
    package, kind, message = name.split("/")
    return f"{package}::{kind}::dds_::{message}_"


def encode(message: Any) -> bytes:
    """Return the CDR bytes of a message made by `ros_messages`."""
    return bytes(type_store().serialize_cdr(message, message.__msgtype__))


def decode(payload: bytes, name: str, source: str) -> Any:
    """Return the message of that type in CDR bytes which came from `source`. Raises RobotError."""
    try:
        return type_store().deserialize_cdr(payload, name)
    except SerdeError as error:
        raise RobotError(
            f"{source}: {len(payload):,} bytes are no {name}: {error} Is the message cut, or of another type?"
        ) from error
