"""Tells fresh messages from late, repeated and strange ones, without trusting anybody's clock to be right.

The sender's clock need not be ours: what counts is how much later a message comes than that sender's quickest one.
"""

import math

from ltvn_core.errors import RobotError
from ltvn_core.robots.ros2.topic_keys import Attachment

MOST_LATE_COMMAND_S = 0.2
"""A command that comes so much later than the quickest is not obeyed, nor forwarded."""
TAKE_OVER_S = 1.0
"""A sender that was silent for so long has left its topic to another."""
_DRIFT = 1e-4
"""Two clocks run apart by less than this share; so quickly the memory of the quickest message fades."""
_JUMP_S = 0.5
"""No message is quicker than the quickest by so much: its sender's clock was set."""
_JUMPS = 10
"""So many in a row are believed."""


class Freshness:
    """The check of one topic that has one sender at a time."""

    def __init__(self, source: str, *, most_late_s: float) -> None:
        """Refuse messages of `source` that come more than `most_late_s` later than its quickest."""
        self._source = source
        self._most_late_s = most_late_s
        self._gid = b""
        self._forget()

    def admit(self, attachment: Attachment, arrived_s: float) -> None:
        """Raise RobotError where a message is late, out of order, of a second sender, or of a clock that was set.

        Args:
            attachment: What came beside the message.
            arrived_s: When it came, on our steady clock.
        """
        self._check_sender(attachment, arrived_s)
        self._check_order(attachment)
        self._check_lateness(attachment.stamp_ns * 1e-9, arrived_s)

    def _check_sender(self, attachment: Attachment, arrived_s: float) -> None:
        if attachment.gid != self._gid:
            if arrived_s - self._heard_s < TAKE_OVER_S:
                raise RobotError(
                    f"{self._source} has two senders at once; the second is not listened to. End one of the programs, "
                    "or give each robot its own ROS_DOMAIN_ID or namespace."
                )
            self._gid = attachment.gid
            self._forget()
        self._heard_s = arrived_s

    def _check_order(self, attachment: Attachment) -> None:
        if attachment.sequence <= self._sequence:
            raise RobotError(
                f"{self._source}: message {attachment.sequence} came after {self._sequence}; it is too old to be used."
            )
        self._sequence = attachment.sequence

    def _check_lateness(self, sent_s: float, arrived_s: float) -> None:
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
        if took_s - self._quickest_s > self._most_late_s:
            raise RobotError(
                f"{self._source}: a message is {took_s - self._quickest_s:.1f} s late; it is not used. Is the link "
                "slow, or was a clock set back? Then start its sender again."
            )

    def _forget(self) -> None:
        self._sequence = -1
        self._quickest_s = math.inf
        self._checked_s = 0.0
        self._heard_s = -math.inf
        self._jumps = 0
