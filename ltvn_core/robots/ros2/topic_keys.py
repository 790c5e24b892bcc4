"""The wire format of `rmw_zenoh`: types and bytes (CDR), keys of topics, and liveliness tokens.

Owns the edition of the types (`rosbags` defines them); the patterns and the check of keys and liveliness tokens; and
the layout of the attachment of each message, 33 bytes with its sequence number, its time and its sender. A peer that
runs ROS reads attachments unchecked, and an invalid one crashes its process. Sends nothing.
"""

import struct
from dataclasses import dataclass
from enum import Enum
from functools import cache
from typing import Any, NamedTuple

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
DIAGNOSTIC = "diagnostic_msgs/msg/DiagnosticStatus"

NO_HASH = "TypeHashNotSupported"
"""Placeholder for the hash, used by robots with ROS 2 Humble."""


def command_type(*, stamped: bool) -> str:
    """Return the type of the messages that drive a robot."""
    return TWIST_STAMPED if stamped else TWIST


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
    """Return the message of a type in CDR bytes that arrived from `source`. Raises RobotError."""
    try:
        return type_store().deserialize_cdr(payload, name)
    except SerdeError as error:
        raise RobotError(
            f"{source}: {len(payload):,} bytes are not a {name}: {error} Is the message cut off, or of another type?"
        ) from error


GID_BYTES = 16
_LAYOUT = struct.Struct(f"<qqB{GID_BYTES}s")
"""Sequence number, nanoseconds, length of the sender's id, and the sender's id."""
TOKENS = "@ros2_lv"
_QOS_REST = "::,1:,:,:,,"
"""Default quality of service after its reliability: a queue of one message."""


class Attachment(NamedTuple):
    """Metadata of one message."""

    sequence: int
    """Sequence number of the sender, from 1."""
    stamp_ns: int
    """Time of sending, in nanoseconds on the sender's clock."""
    gid: bytes
    """Id of the sender, 16 bytes."""

    def to_bytes(self) -> bytes:
        """Return the 33 bytes."""
        return _LAYOUT.pack(self.sequence, self.stamp_ns, GID_BYTES, self.gid)

    @classmethod
    def from_bytes(cls, data: bytes | None, source: str) -> "Attachment":
        """Read the attachment of a message of `source`. Raises RobotError if it is invalid."""
        sequence, stamp_ns, length, gid = (
            _LAYOUT.unpack(data) if data and len(data) == _LAYOUT.size else (-1, 0, 0, b"")
        )
        if length != GID_BYTES or sequence < 0:
            raise RobotError(
                f"{source}: the attachment of a message ({len(data or b'')} bytes) is not the {_LAYOUT.size} bytes of "
                "rmw_zenoh; update rmw_zenoh_cpp on the robot (Jazzy: 0.2.4 or newer)."
            )
        return cls(sequence, stamp_ns, gid)


class Role(Enum):
    """Role of an endpoint in its topic, as encoded in tokens."""

    PUBLISHES = "MP"
    SUBSCRIBES = "MS"


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic of one type in one ROS domain."""

    name: str
    """Name with a leading slash, such as `/cmd_vel`."""
    type_name: str
    """Name of the type, such as `geometry_msgs/msg/Twist`."""
    domain: int = 0
    """The robot's ROS_DOMAIN_ID."""

    @property
    def key(self) -> str:
        """Key at which messages of exactly this type are published."""
        return f"{self._place}/{dds_name(self.type_name)}/{type_hash(self.type_name)}"

    @property
    def unhashed_key(self) -> str:
        """Key at which ROS 2 Humble, which has no hashes of types, expects these messages."""
        return f"{self._place}/{dds_name(self.type_name)}/{NO_HASH}"

    @property
    def any_type_key(self) -> str:
        """Key expression for messages of any type, so that a wrong type can be distinguished from no message."""
        return f"{self._place}/*/*"

    @property
    def _place(self) -> str:
        return f"{self.domain}/{self.name.strip('/')}"

    def token(self, role: Role, *, session: str, node: str, number: int, best_effort: bool = False) -> str:
        """Return the liveliness token of an endpoint, which exists as long as the endpoint does.

        Args:
            role: Whether the node publishes or subscribes.
            session: The Zenoh id of the session.
            node: Name of the node, in the root namespace.
            number: Number of the endpoint in the session; 0 is the node itself.
            best_effort: Whether lost messages are not sent again.
        """
        return (
            f"{TOKENS}/{self.domain}/{session}/0/{number}/{role.value}/%/%/{node}/{self.name.replace('/', '%')}/"
            f"{dds_name(self.type_name)}/{type_hash(self.type_name)}/{'2' if best_effort else ''}{_QOS_REST}"
        )

    def edition_of(self, token: str) -> str | None:
        """Return the hash in a token of this topic, or `NO_HASH`; None if its messages cannot be decoded."""
        kind, edition = token.split("/")[10:12]
        is_known = kind == dds_name(self.type_name) and edition in (type_hash(self.type_name), NO_HASH)
        return edition if is_known else None

    def check_key(self, key: str) -> None:
        """Raise RobotError if a message of this topic has another type, or another edition of this type."""
        kind, edition = key.split("/")[-2:]
        if kind != dds_name(self.type_name):
            found = kind.replace("::dds_::", "::").replace("::", "/").removesuffix("_")
            raise RobotError(
                f"{self.name} has the type {found}, expected {self.type_name}; correct the topic in the "
                "robot's profile, or whether its commands are stamped."
            )
        if edition not in (type_hash(self.type_name), NO_HASH):
            raise RobotError(
                f"{self.name} has another version of {self.type_name}: its hash is {edition:.24}..., expected "
                f"{type_hash(self.type_name):.24}...; is the robot's ROS older than Humble, or the type changed?"
            )


def endpoint_tokens(role: Role, domain: int, name: str) -> str:
    """Return the key expression of the tokens of endpoints of a topic, of any type and edition."""
    return f"{TOKENS}/{domain}/*/*/*/{role.value}/*/*/*/{name.replace('/', '%')}/*/*/*"


def node_token(session: str, node: str, domain: int) -> str:
    """Return the liveliness token of a node."""
    return f"{TOKENS}/{domain}/{session}/0/0/NN/%/%/{node}"
