"""Log lines that a page can cause at will: one now and then, with how many were left out."""

import logging
import threading
import time
from collections.abc import Callable

EVERY_S = 5.0


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
