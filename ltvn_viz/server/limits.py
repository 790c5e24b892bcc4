"""What whoever connects may use up at most: lines of the log, messages, and connections.

Every user of the machine can connect. A line that they can cause at will is written now and then, with how many were
left out; that holds for the lines of the library `websockets` as well. Without a limit, connections on which no token
was shown would use up the files that a process may open.

All pages are heard by one thread. A page of ours says less than a hundred messages in a second, with every key and the
stick in use; one that says many more has gone wrong or was made by hand, and loses its socket.
"""

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from websockets.asyncio.server import ServerConnection
from websockets.frames import CloseCode

from ltvn_viz.server.drive_messages import MessageError

EVERY_S = 5.0
_SAID_OTHERWISE = ("opening handshake", "connection open", "connection rejected", "server ")
"""Lines about each connection and ordinary HTTP answer, and about the library's own life."""


class LimitedLog:
    """One kind of line, written at most once in `EVERY_S` seconds. Safe from any thread."""

    def __init__(self, logger: logging.Logger, clock: Callable[[], float] = time.monotonic) -> None:
        """Write to `logger`."""
        self._logger = logger
        self._clock = clock
        self._lock = threading.Lock()
        self._due = float("-inf")
        self._left_out = 0

    def log(self, level: int, message: str, *arguments: object) -> None:
        """Write a line, or count it as left out."""
        with self._lock:
            if self._clock() < self._due:
                self._left_out += 1
                return
            left_out, self._left_out = self._left_out, 0
            self._due = self._clock() + EVERY_S
        more = f" (and {left_out} more like it before)" if left_out else ""
        self._logger.log(level, message + more, *arguments)


class _OneLineEach(logging.Filter):
    """Drops what is said otherwise, and writes each error as a line without its traceback."""

    def __init__(self, logger: logging.Logger) -> None:
        super().__init__()
        self._lines: dict[str, LimitedLog] = {}
        self._logger = logger

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether a record is written as it is."""
        message = record.getMessage()
        if message.startswith(_SAID_OTHERWISE):
            return False
        if record.exc_info is None:
            return True
        error = record.exc_info[1]
        # The messages are the library's own and few.
        line = self._lines.setdefault(message, LimitedLog(self._logger))
        line.log(record.levelno, "%s: %s %.200s", message, type(error).__name__, error)
        self._logger.debug("%s", message, exc_info=record.exc_info)
        return False


def quiet_logger() -> logging.Logger:
    """Return the logger that `websockets` is to write to."""
    quiet = logging.getLogger(f"{__name__}.library")
    if not quiet.filters:
        quiet.addFilter(_OneLineEach(logging.getLogger(__name__)))
    return quiet


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
        self._per_s = per_s
        self._most = most
        self._clock = clock
        self._left = most
        self._counted = clock()

    def take(self, amount: float = 1.0) -> float:
        """Take an amount; return after how many seconds it is covered, 0 where it is so already."""
        now = self._clock()
        self._left = min(self._most, self._left + (now - self._counted) * self._per_s) - amount
        self._counted = now
        return max(0.0, -self._left / self._per_s)


class PageBudget:
    """Counts what comes on one socket."""

    def __init__(self, pace: Pace, clock: Callable[[], float] = time.monotonic) -> None:
        """Set the limit."""
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


logger = logging.getLogger(__name__)

MAX_STRANGERS = 100
"""Far fewer than the files that any system lets a process open, far more than a browser's connections."""

READ_BYTES = 8 * 1024
"""Hundreds of the smallest messages, which take some milliseconds."""
FAREWELL_S = 0.5
"""Time for the reason of a closing to reach the page, in seconds."""


class Strangers:
    """The connections without a token, the oldest first."""

    def __init__(self, most: int = MAX_STRANGERS) -> None:
        """Set the largest number of entries."""
        self._most = most
        self._waiting: dict[GuardedConnection, None] = {}
        self._log = LimitedLog(logger)

    def __len__(self) -> int:
        """Return how many there are."""
        return len(self._waiting)

    def come(self, connection: "GuardedConnection") -> None:
        """Take a new connection in; the oldest one goes where there are too many.

        A page shows its token at once, so that it is seldom the oldest; refusing the newest would let a few idle
        connections keep every page out.
        """
        self._waiting[connection] = None
        if len(self._waiting) > self._most:
            oldest = next(iter(self._waiting))
            self.leave(oldest)
            oldest.transport.abort()
            self._log.log(logging.WARNING, "more than %d connections without the token: closed the oldest", self._most)

    def leave(self, connection: "GuardedConnection") -> None:
        """Forget a connection that is closed, or has shown the token."""
        self._waiting.pop(connection, None)


class GuardedConnection(ServerConnection):
    """A connection that is a stranger's until it is known, and never keeps the others waiting for long."""

    def __init__(self, strangers: Strangers, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._strangers = strangers
        self._is_heard = True

    def connection_made(self, transport: Any) -> None:
        """Count it in."""
        # All that is read at once is taken apart before another connection is heard. The event loop of Windows fixes
        # the amount before and keeps its own.
        transport.max_size = READ_BYTES
        super().connection_made(transport)
        self._strangers.come(self)

    def connection_lost(self, exc: Exception | None) -> None:
        """Count it out."""
        self._strangers.leave(self)
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Take apart what came, unless the connection has been hung up."""
        if self._is_heard:
            super().data_received(data)

    async def hang_up(self, told: str) -> None:
        """Close a page's socket, say why, and leave unread what it still sends, its farewell among it."""
        self._is_heard = False
        self.close_timeout = FAREWELL_S
        await self.close(CloseCode.POLICY_VIOLATION, told)
