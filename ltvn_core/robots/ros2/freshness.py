"""Rejects late and repeated messages, and those of a second sender, without synchronised clocks.

The sender's clock may differ from ours: the latency of a message is measured against that sender's quickest one.
"""

import math

from ltvn_core.errors import RobotError
from ltvn_core.robots.ros2.topic_keys import Attachment

MOST_LATE_COMMAND_S = 0.2
"""Greatest latency of a command that is obeyed or forwarded, relative to the quickest command, in seconds."""
TAKE_OVER_S = 1.0
"""Silence of a sender after which another may take over its topic, in seconds."""
_DRIFT = 1e-4
"""Greatest relative drift of two clocks; the least latency so far is raised at this rate."""
_JUMP_S = 0.5
"""If a message is quicker than the quickest so far by more than this time, in seconds, the sender's clock was set."""
_JUMPS = 10
"""Number of consecutive messages after which a changed clock is accepted."""


class Freshness:
    """Checks the messages of one topic, which has one sender at a time."""

    def __init__(self, source: str, *, most_late_s: float) -> None:
        """Reject messages of `source` whose latency exceeds that of the quickest message by more than `most_late_s`."""
        self._source = source
        self._most_late_s = most_late_s
        self._gid = b""
        self._sequence = -1
        self._quickest_s = math.inf
        self._checked_s = 0.0
        self._heard_s = -math.inf
        self._jumps = 0

    def admit(self, attachment: Attachment, arrived_s: float) -> float:
        """Return how late a message is relative to the quickest one, in seconds.

        Args:
            attachment: The metadata of the message.
            arrived_s: Time of arrival on our monotonic clock, in seconds.

        Raises:
            RobotError: The message is late, out of order, from a second sender, or from a clock that was set.
        """
        if attachment.gid != self._gid:
            if arrived_s - self._heard_s < TAKE_OVER_S:
                raise RobotError(
                    f"{self._source} has two senders at once; the second is ignored. Stop one of the programs, "
                    "or give each robot its own ROS_DOMAIN_ID or namespace."
                )
            self._gid, self._sequence, self._quickest_s, self._jumps = attachment.gid, -1, math.inf, 0
        self._heard_s = arrived_s
        if attachment.sequence <= self._sequence:
            raise RobotError(
                f"{self._source}: message {attachment.sequence} came after {self._sequence}; it is too old to be used."
            )
        self._sequence = attachment.sequence
        return self._lateness_s(attachment.stamp_ns * 1e-9, arrived_s)

    def _lateness_s(self, sent_s: float, arrived_s: float) -> float:
        took_s = arrived_s - sent_s
        if took_s < self._quickest_s - _JUMP_S and self._quickest_s < math.inf:
            self._jumps += 1
            if self._jumps < _JUMPS:
                ahead_s = self._quickest_s - took_s
                raise RobotError(f"{self._source}: a message is from {ahead_s:.1f} s in the future; was a clock set?")
            self._quickest_s = math.inf
        self._jumps = 0
        faded_s = self._quickest_s + _DRIFT * (arrived_s - self._checked_s)
        self._quickest_s = min(took_s, faded_s)
        self._checked_s = arrived_s
        late_s = took_s - self._quickest_s
        if late_s > self._most_late_s:
            raise RobotError(
                f"{self._source}: a message is {late_s:.1f} s late; it is not used. Is the link slow, or was a clock "
                "set back? If a clock was set back, restart the sender."
            )
        return late_s
