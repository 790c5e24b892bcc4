"""MCAP files with channels that ROS 2 did not write, beside or instead of its own.

Owns the look at how a file and its channels are encoded, and what the library `rosbags` has to be lenient about.
"""

import struct
from pathlib import Path
from typing import BinaryIO

from rosbags.interfaces import Connection, ConnectionExtRosbag2, MessageDefinition, MessageDefinitionFormat
from rosbags.rosbag2 import storage_mcap

from ltvn_core.errors import DriveError

CDR = "cdr"
"""How ROS 2 encodes messages."""
_MAGIC = b"\x89MCAP0\r\n"
_HEADER = struct.Struct("<BQI")
"""After the magic: the kind of the first record, its length, and the length of the profile's name."""
_MOST_NAME_BYTES = 100
_SCHEMAS = ("ros2msg", "ros2idl", "omgidl", "")


def tolerate_foreign_channels() -> None:
    """Have `rosbags` open an MCAP whose schemas are of encodings that it does not know, or no text."""
    known = storage_mcap.get_msgdef

    def definition(schema: storage_mcap.Schema | None) -> MessageDefinition:
        is_known = schema is None or schema.encoding in _SCHEMAS
        return known(schema) if is_known else MessageDefinition(MessageDefinitionFormat.NONE, "")

    def text(stream: BinaryIO) -> str:
        return storage_mcap.read_bytes(stream).decode(errors="replace")

    if known.__module__ == storage_mcap.__name__:  # Not done yet.
        storage_mcap.get_msgdef = definition
        storage_mcap.read_string = text


def foreign_encoding(connection: Connection) -> str:
    """Return how the messages of a connection are encoded where that is not ROS's way, else ""."""
    encoding = connection.ext.serialization_format if isinstance(connection.ext, ConnectionExtRosbag2) else CDR
    return "" if encoding == CDR else encoding or "unknown"


def require_ros2(file: Path) -> None:
    """Raise DriveError where an MCAP says that another program than ROS 2 wrote it."""
    try:
        with file.open("rb") as stream:
            head = stream.read(len(_MAGIC) + _HEADER.size + _MOST_NAME_BYTES)
    except OSError:
        return  # Whoever opens it says so.
    if not head.startswith(_MAGIC) or len(head) < len(_MAGIC) + _HEADER.size:
        return
    _, _, length = _HEADER.unpack_from(head, len(_MAGIC))
    begin = len(_MAGIC) + _HEADER.size
    profile = head[begin : begin + min(length, _MOST_NAME_BYTES)].decode(errors="replace")
    if profile == "ros2":
        return
    if profile == "ros1":
        raise DriveError(
            f"{file} was not written by ROS 2: it holds messages of ROS 1 (profile ros1). Import the .bag that it was "
            "made of, or convert it to a .bag of ROS 1 or a bag of ROS 2."
        )
    raise DriveError(
        f"{file} was not written by ROS 2: its profile is {profile!r:.40}, not 'ros2'. Where its messages are those "
        "of ROS 2 (encoding cdr), convert it by `ros2 bag convert`; else export the drive as a bag of ROS 2, or its "
        "images as a folder of pictures."
    )
