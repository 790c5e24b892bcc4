"""Which pages are there, and since when none is.

A page says that it is there twenty times a second, from a thread of its own that neither drawing nor lying behind
another window slows down. It is gone when its socket closes, and when it falls silent: frozen, or out of reach. Time
counts only while the thread that hears the pages runs, so that a server that stalls takes no page for gone.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from enum import StrEnum

from ltvn_viz.server.driver_seat import ClientId

HERE_LEASE_S = 0.25
"""A page that was silent for longer is gone."""
TICK_S = 0.02
"""How often silence is looked for."""


class Loss(StrEnum):
    """How the last page went; the value ends the sentence “The last page ...”."""

    CLOSED = "was closed"
    SILENT = "froze or lost its connection"


@dataclass(frozen=True, slots=True)
class Absence:
    """Nobody is there."""

    loss: Loss
    since: datetime
    """Local time."""


class Presence:
    """Knows the pages by their signs of life."""

    def __init__(
        self,
        *,
        lease_s: float = HERE_LEASE_S,
        clock: Callable[[], float] = time.monotonic,
        today: Callable[[], datetime] = datetime.now,
    ) -> None:
        """Begin without pages; measure silence by `clock`, in seconds."""
        self._lease_s, self._clock, self._today = lease_s, clock, today
        self._heard: dict[ClientId, float] = {}
        self._counted_s = 0.0
        self._ticked = clock()
        self.absence: Absence | None = None
        """Set while no page is there; None before the first one came, for nobody can be missed then."""

    def hear(self, client: ClientId) -> None:
        """Note that a page is there."""
        self._heard[client] = self._counted_s
        self.absence = None

    def leave(self, client: ClientId) -> None:
        """Note that a page's socket is closed."""
        was_there = self.absence is None
        self._heard.pop(client, None)
        if was_there and not self._is_somebody_there():
            self.absence = Absence(Loss.CLOSED, self._today())

    def tick(self) -> bool:
        """Let time pass; return whether the last page fell silent just now. To be called every `TICK_S`."""
        now = self._clock()
        # A late call means that this thread stalled, and with it the hearing of the pages.
        self._counted_s += min(now - self._ticked, 2 * TICK_S)
        self._ticked = now
        if self.absence is not None or not self._heard or self._is_somebody_there():
            return False
        self.absence = Absence(Loss.SILENT, self._today())
        return True

    def _is_somebody_there(self) -> bool:
        return any(self._counted_s - heard <= self._lease_s for heard in self._heard.values())
