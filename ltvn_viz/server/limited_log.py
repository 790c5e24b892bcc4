"""Log lines that whoever connects can cause at will: one now and then, with how many were left out.

Holds the lines of the library `websockets` to that as well.
"""

import logging
import threading
import time
from collections.abc import Callable

EVERY_S = 5.0
_SAID_OTHERWISE = ("opening handshake", "connection open", "connection rejected", "server ")
"""Lines about each connection and ordinary HTTP answer, and about the library's own life."""


class LimitedLog:
    """One kind of line, written at most once in `every_s` seconds. Safe from any thread."""

    def __init__(
        self, logger: logging.Logger, *, every_s: float = EVERY_S, clock: Callable[[], float] = time.monotonic
    ) -> None:
        """Write to `logger`."""
        self._logger, self._every_s, self._clock = logger, every_s, clock
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
            self._due = self._clock() + self._every_s
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
