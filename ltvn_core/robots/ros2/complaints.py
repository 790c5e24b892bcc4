"""Says what is wrong with what a robot sends, each kind once in a while, so that ten errors a second stay readable."""

import logging
import re
import time

from ltvn_core.errors import RobotError

_LOG = logging.getLogger(__name__)
_AGAIN_S = 5.0


class Complaints:
    """What was said lately."""

    def __init__(self) -> None:
        self._said_s: dict[str, float] = {}

    def say(self, error: RobotError) -> None:
        """Log an error, unless one that differs in its numbers alone was logged in the last 5 seconds."""
        kind, now_s = re.sub(r"[0-9.]+", "#", str(error)), time.monotonic()
        if now_s - self._said_s.get(kind, -_AGAIN_S) >= _AGAIN_S:
            self._said_s[kind] = now_s
            _LOG.warning("%s", error)
