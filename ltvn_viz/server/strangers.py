"""Connections on which no token was shown yet: how many there may be, and that none of them can fill the log.

Every user of the machine can connect. Without a limit they would use up the files that a process may open, and the
server would log each connection that it cannot take.
"""

import logging
from typing import Any

from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request

from ltvn_viz.server.limited_log import LimitedLog

logger = logging.getLogger(__name__)

MAX_STRANGERS = 100
"""Far fewer than the files that any system lets a process open, far more than a browser's connections."""


class Strangers:
    """The connections without a token, the oldest first."""

    def __init__(self, most: int = MAX_STRANGERS) -> None:
        """Keep at most so many."""
        self._most = most
        self._waiting: dict[StrangerConnection, None] = {}
        self.log = LimitedLog(logger)

    def __len__(self) -> int:
        """Return how many there are."""
        return len(self._waiting)

    def come(self, connection: "StrangerConnection") -> None:
        """Take a new connection in; the oldest one goes where there are too many.

        A page shows its token at once, so that it is seldom the oldest; refusing the newest would let a few idle
        connections keep every page out.
        """
        self._waiting[connection] = None
        if len(self._waiting) > self._most:
            oldest = next(iter(self._waiting))
            self.leave(oldest)
            oldest.transport.abort()
            self.log.log(logging.WARNING, "more than %d connections without the token: closed the oldest", self._most)

    def leave(self, connection: "StrangerConnection") -> None:
        """Forget a connection that is closed, or has shown the token."""
        self._waiting.pop(connection, None)


class StrangerConnection(ServerConnection):
    """A connection that is a stranger's until it is known, and cannot make the event loop log a traceback."""

    def __init__(self, strangers: Strangers, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._strangers = strangers

    def connection_made(self, transport: Any) -> None:
        """Count it in."""
        super().connection_made(transport)
        self._strangers.come(self)

    def connection_lost(self, exc: Exception | None) -> None:
        """Count it out."""
        self._strangers.leave(self)
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Read what came; what is no request, or a second one, ends the connection and not in the log's tracebacks."""
        try:
            super().data_received(data)
        except Exception as error:
            self._strangers.log.log(logging.INFO, "closed a connection that broke the protocol: %s", _one_line(error))
            self.transport.abort()

    def process_event(self, event: Any) -> None:
        """Take a request or a frame; a connection has one request, as each answer says."""
        if self.request is not None and isinstance(event, Request):
            self.transport.abort()
        else:
            super().process_event(event)


def _one_line(error: Exception) -> str:
    return f"{type(error).__name__} {str(error)[:80]!r}"
