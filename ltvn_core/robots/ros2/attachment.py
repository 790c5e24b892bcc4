"""The 33 bytes that `rmw_zenoh` puts beside each message: its number, its time and who sent it.

A peer that runs ROS reads them without looking, and a wrong one ends its process. Owns their layout.
"""

import struct
from typing import NamedTuple

from ltvn_core.errors import RobotError

GID_BYTES = 16
_LAYOUT = struct.Struct(f"<qqB{GID_BYTES}s")
"""Number, nanoseconds, the length of what follows, and the sender."""


class Attachment(NamedTuple):
    """What is known of one message beside its contents."""

    sequence: int
    """Counts the messages of its sender, from 1."""
    stamp_ns: int
    """When it was sent, in nanoseconds of the sender's clock."""
    gid: bytes
    """Names the sender, 16 bytes."""

    def to_bytes(self) -> bytes:
        """Return the 33 bytes. Raises ValueError for a sender's name of another length."""
        if len(self.gid) != GID_BYTES:
            raise ValueError(f"A sender is named by {GID_BYTES} bytes, got {len(self.gid)}.")
        return _LAYOUT.pack(self.sequence, self.stamp_ns, GID_BYTES, self.gid)

    @classmethod
    def from_bytes(cls, data: bytes | None, source: str) -> "Attachment":
        """Read the bytes that came with a message of `source`. Raises RobotError where they are something else."""
        if data is None or len(data) != _LAYOUT.size:
            found = "nothing" if data is None else f"{len(data)} bytes"
            raise RobotError(
                f"{source}: beside the message stood {found}, not the {_LAYOUT.size} bytes of rmw_zenoh; update "
                "rmw_zenoh_cpp on the robot (Jazzy: 0.2.4 or newer)."
            )
        sequence, stamp_ns, length, gid = _LAYOUT.unpack(data)
        if length != GID_BYTES or sequence < 0:
            raise RobotError(
                f"{source}: the bytes beside the message name a sender of {length} bytes and message {sequence}; "
                f"rmw_zenoh writes {GID_BYTES} bytes and counts from 1."
            )
        return cls(sequence, stamp_ns, gid)
