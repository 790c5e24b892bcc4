"""What the library `websockets` may write into the log: one line now and then, for whoever connects can cause it."""

import logging

from ltvn_viz.server.limited_log import LimitedLog

_SAID_OTHERWISE = ("opening handshake", "connection rejected", "server ")
"""Lines about each ordinary HTTP answer and the library's own life."""


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
