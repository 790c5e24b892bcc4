"""MCAP files that ROS 2 did not write, or not alone.

Owns what the library `rosbags` has to be lenient about, and the files that are refused.
"""

import struct
from pathlib import Path
from typing import BinaryIO

from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat, Qos
from rosbags.rosbag2 import storage_mcap

from ltvn_core.errors import DriveError

_MAGIC = b"\x89MCAP0\r\n"
_HEADER = struct.Struct("<BQI")
"""After the magic: the kind of the first record, its length, and the length of the profile's name."""
_MOST_NAME_BYTES = 100
_PROFILE = "ros2"
"""All that the library opens."""
_OFFERS = "offered_qos_profiles"
"""The key of the metadata that the library asks for."""
_SCHEMAS = ("ros2msg", "ros2idl", "omgidl", "")


def tolerate_foreign_channels() -> None:
    """Have `rosbags` open an MCAP of any profile whose schemas are of encodings that it does not know, or no text.

    Channels say one by one how they are encoded.
    """
    known = storage_mcap.get_msgdef

    def definition(schema: storage_mcap.Schema | None) -> MessageDefinition:
        is_known = schema is None or schema.encoding in _SCHEMAS
        return known(schema) if is_known else MessageDefinition(MessageDefinitionFormat.NONE, "")

    def text(stream: BinaryIO) -> str:
        is_first = stream.tell() == 0  # As the profile is, and the first key of a channel's metadata.
        said = storage_mcap.read_bytes(stream).decode(errors="replace")
        return _PROFILE if is_first and said != _OFFERS else said

    offered = storage_mcap.get_qos

    def offers(text: bytes) -> list[Qos]:
        try:
            return offered(text)
        except Exception:  # Strangers write there what they like, and reading needs none of it.
            return []

    if known.__module__ == storage_mcap.__name__:  # Not done yet.
        storage_mcap.get_msgdef = definition
        storage_mcap.read_string = text
        storage_mcap.get_qos = offers


def refuse_ros1(file: Path) -> None:
    """Raise DriveError where an MCAP says that it holds messages of ROS 1."""
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
    if profile == "ros1":
        raise DriveError(
            f"{file} was not written by ROS 2: it holds messages of ROS 1 (profile ros1). Import the .bag that it was "
            "made of, or convert it to a .bag of ROS 1 or a bag of ROS 2."
        )
