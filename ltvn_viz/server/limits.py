"""Rate limits against denial of service: for log lines, messages, and connections without a token.

Every user of the machine can connect. Log lines that a client can cause are therefore written at limited intervals,
with the number of lines left out; this includes the lines of the library `websockets`. Connections without a token are
limited, because they would otherwise exhaust the file descriptors of the process.

One thread serves all pages. A page of ours sends less than a hundred messages per second, even with all keys and the
stick in use; a page that sends far more is faulty or malicious, and loses its socket.
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
"""First words of log lines that are dropped: about single connections, HTTP responses, and the library's start and
stop."""


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
    """Drops lines that are logged elsewhere, and writes each error as one line without a traceback."""

    def __init__(self, logger: logging.Logger) -> None:
        super().__init__()
        self._lines: dict[str, LimitedLog] = {}
        self._logger = logger

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether a record is written unchanged."""
        message = record.getMessage()
        if message.startswith(_SAID_OTHERWISE):
            return False
        if record.exc_info is None:
            return True
        error = record.exc_info[1]
        # The library has only a few different messages.
        line = self._lines.setdefault(message, LimitedLog(self._logger))
        line.log(record.levelno, "%s: %s %.200s", message, type(error).__name__, error)
        self._logger.debug("%s", message, exc_info=record.exc_info)
        return False


def quiet_logger() -> logging.Logger:
    """Return the logger for `websockets`."""
    quiet = logging.getLogger(f"{__name__}.library")
    if not quiet.filters:
        quiet.addFilter(_OneLineEach(logging.getLogger(__name__)))
    return quiet


class TooManyMessagesError(MessageError):
    """A page floods its socket."""

    told = "too many messages"


@dataclass(frozen=True, slots=True)
class Pace:
    """Limits for the messages on one socket of a page."""

    messages_per_s: float = 400.0
    messages_at_once: float = 1000.0
    """Burst of messages, which a connection may deliver after a stall."""
    bytes_per_s: float = 32.0 * 2**20
    bytes_at_once: float = 64.0 * 2**20
    """Burst of bytes, so that the largest upload passes without waiting."""


class Allowance:
    """A token bucket: an amount that is used up and refilled with time."""

    def __init__(self, per_s: float, most: float, clock: Callable[[], float] = time.monotonic) -> None:
        """Start with `most`, which is also the capacity."""
        self._per_s = per_s
        self._most = most
        self._clock = clock
        self._left = most
        self._counted = clock()

    def take(self, amount: float = 1.0) -> float:
        """Take an amount; return the time in seconds until it is refilled, 0 if it was available."""
        now = self._clock()
        self._left = min(self._most, self._left + (now - self._counted) * self._per_s) - amount
        self._counted = now
        return max(0.0, -self._left / self._per_s)


class PageBudget:
    """Counts the messages and bytes on one socket."""

    def __init__(self, pace: Pace, clock: Callable[[], float] = time.monotonic) -> None:
        """Set the limits."""
        self._pace = pace
        self._messages = Allowance(pace.messages_per_s, pace.messages_at_once, clock)
        self._bytes = Allowance(pace.bytes_per_s, pace.bytes_at_once, clock)

    def count(self, message: str | bytes) -> float:
        """Count a message; return the time in seconds until the next one may be read.

        Raises TooManyMessagesError for too many messages. Too many bytes only cause a delay.
        """
        if self._messages.take() > 0:
            raise TooManyMessagesError(f"more than {self._pace.messages_per_s:.0f} messages in a second")
        return self._bytes.take(len(message))


logger = logging.getLogger(__name__)

MAX_STRANGERS = 100
"""Maximum number of connections without a token: far below the limit of open files, far above a browser's need."""

READ_BYTES = 8 * 1024
"""Number of bytes read at once: hundreds of the smallest messages, which take a few milliseconds to process."""
FAREWELL_S = 0.5
"""Time for the reason of the closing to reach the page, in seconds."""


class Strangers:
    """The connections without a token, the oldest first."""

    def __init__(self, most: int = MAX_STRANGERS) -> None:
        """Set the maximum number of connections."""
        self._most = most
        self._waiting: dict[GuardedConnection, None] = {}
        self._log = LimitedLog(logger)

    def __len__(self) -> int:
        """Return the number of connections."""
        return len(self._waiting)

    def come(self, connection: "GuardedConnection") -> None:
        """Add a new connection; close the oldest one if there are too many.

        A page sends its token at once, so it is seldom the oldest; if the newest were refused, idle connections could
        keep every page out.
        """
        self._waiting[connection] = None
        if len(self._waiting) > self._most:
            oldest = next(iter(self._waiting))
            self.leave(oldest)
            oldest.transport.abort()
            self._log.log(logging.WARNING, "more than %d connections without the token: closed the oldest", self._most)

    def leave(self, connection: "GuardedConnection") -> None:
        """Remove a connection that is closed or has sent the token."""
        self._waiting.pop(connection, None)


class GuardedConnection(ServerConnection):
    """A connection that counts as a stranger until it has sent the token, and that cannot delay others for long."""

    def __init__(self, strangers: Strangers, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._strangers = strangers
        self._is_heard = True

    def connection_made(self, transport: Any) -> None:
        """Add the connection to the strangers."""
        # All bytes that are read at once are parsed before other connections are served. The event loop of Windows
        # ignores this limit and uses its own.
        transport.max_size = READ_BYTES
        super().connection_made(transport)
        self._strangers.come(self)

    def connection_lost(self, exc: Exception | None) -> None:
        """Remove the connection from the strangers."""
        self._strangers.leave(self)
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Parse the received bytes, unless the connection was hung up."""
        if self._is_heard:
            super().data_received(data)

    async def hang_up(self, told: str) -> None:
        """Close a page's socket with a reason, and ignore everything that it still sends, including its close frame."""
        self._is_heard = False
        self.close_timeout = FAREWELL_S
        await self.close(CloseCode.POLICY_VIOLATION, told)
