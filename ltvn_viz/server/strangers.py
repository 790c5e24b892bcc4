"""Connections on which no token was shown yet, and how many of them there may be.

Every user of the machine can connect. Without a limit they would use up the files that a process may open, and the
server would log each connection that it cannot take.
"""

import logging
from typing import Any

from websockets.asyncio.server import ServerConnection
from websockets.frames import CloseCode

from ltvn_viz.server.limited_log import LimitedLog

logger = logging.getLogger(__name__)

MAX_STRANGERS = 100
"""Far fewer than the files that any system lets a process open, far more than a browser's connections."""

READ_BYTES = 8 * 1024
"""Hundreds of the smallest messages, which take some milliseconds."""
FAREWELL_S = 0.5
"""So long the reason of a closing may take to reach the page."""


class Strangers:
    """The connections without a token, the oldest first."""

    def __init__(self, most: int = MAX_STRANGERS) -> None:
        """Keep at most so many."""
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
