"""How much one page may say, so that a page which never stops talking takes no time from the one that drives.

All pages are heard by one thread. A page of ours says less than a hundred messages in a second, with every key and the
stick in use; one that says many more has gone wrong or was made by hand, and loses its socket.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

from ltvn_viz.server.drive_messages import MessageError


class TooManyMessagesError(MessageError):
    """A page floods its socket."""

    told = "too many messages"


@dataclass(frozen=True, slots=True)
class Pace:
    """What one socket of a page may say."""

    messages_per_s: float = 400.0
    messages_at_once: float = 1000.0
    """A connection that stood still brings what was said meanwhile at once."""
    bytes_per_s: float = 32.0 * 2**20
    bytes_at_once: float = 64.0 * 2**20
    """The largest upload comes through without waiting."""


class Allowance:
    """An amount that is used up and comes back with time."""

    def __init__(self, per_s: float, most: float, clock: Callable[[], float] = time.monotonic) -> None:
        """Begin with `most`, which is also the most that is saved."""
        self._per_s, self._most, self._clock = per_s, most, clock
        self._left, self._counted = most, clock()

    def take(self, amount: float = 1.0) -> float:
        """Take an amount; return after how many seconds it is covered, 0 where it is so already."""
        now = self._clock()
        self._left = min(self._most, self._left + (now - self._counted) * self._per_s) - amount
        self._counted = now
        return max(0.0, -self._left / self._per_s)


class PageBudget:
    """Counts what comes on one socket."""

    def __init__(self, pace: Pace, clock: Callable[[], float] = time.monotonic) -> None:
        """Allow so much."""
        self._pace = pace
        self._messages = Allowance(pace.messages_per_s, pace.messages_at_once, clock)
        self._bytes = Allowance(pace.bytes_per_s, pace.bytes_at_once, clock)

    def count(self, message: str | bytes) -> float:
        """Count a message in; return after how many seconds the next one may be read.

        Raises TooManyMessagesError for more messages than any page has to say. Many bytes only have to wait.
        """
        if self._messages.take() > 0:
            raise TooManyMessagesError(f"more than {self._pace.messages_per_s:.0f} messages in a second")
        return self._bytes.take(len(message))
