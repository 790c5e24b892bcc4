"""ROBOTIS's `zenoh-ros2-sdk`, which speaks to robots of ROS 2 with code of its own, made ready without a network."""

from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

from rosbags.typesys import Stores, get_typestore
from zenoh_ros2_sdk import ZenohSession, get_registry

from ltvn_core.robots.ros2.zenoh_link import check_address

_TYPES = (
    "geometry_msgs/msg/Twist",
    "sensor_msgs/msg/Image",
    "nav_msgs/msg/Odometry",
    "sensor_msgs/msg/CameraInfo",
    "sensor_msgs/msg/CompressedImage",
    "std_msgs/msg/Bool",
    "tf2_msgs/msg/TFMessage",
)
_RULE = "=" * 80


def write_definitions(folder: Path) -> None:
    """Write the definitions of the types in use as .msg files, as a ROS installation has them."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for name in _TYPES:
        first, *others = store.generate_msgdef(name, ros_version=2)[0].split(_RULE)
        _write(folder, name, first)
        for other in others:
            head, _, body = other.strip().partition("\n")
            package, _, kind = head.removeprefix("MSG: ").partition("/")
            _write(folder, f"{package}/msg/{kind}", body)


def _write(folder: Path, name: str, text: str) -> None:
    file = folder / f"{name}.msg"
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text.strip() + "\n", encoding="utf-8")


@contextmanager
def other_makers_session(address: str, folder: Path) -> Iterator[int]:
    """Yield the port at which the other maker's program meets ours."""
    write_definitions(folder)
    get_registry().messages_dir = folder
    port = check_address(address)[2]
    with closing(ZenohSession.get_instance("127.0.0.1", port)):
        yield port
