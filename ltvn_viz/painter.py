"""Draws snapshots in a thread of its own; the newest wins.

So a slow page, or a big map that has just changed, holds up neither the robot nor the person who drives it.
"""

import logging
import threading
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from typing import Protocol

import viser

from ltvn_viz.server.driver_seat import ClientId
from ltvn_viz.session.snapshot import Snapshot

logger = logging.getLogger(__name__)


class PagePart(Protocol):
    """A layer or a panel."""

    def show(self, snapshot: Snapshot) -> None:
        """Show `snapshot`."""
        ...


class OwnParts:
    """Parts that each page has for itself: made when the page comes, and drawn for it alone."""

    def __init__(
        self,
        clients: Callable[[], Iterable[viser.ClientHandle]],
        make: Callable[[viser.ClientHandle], Sequence[PagePart]],
        number_of: Callable[[int], ClientId | None],
    ) -> None:
        """Let `make` add the parts of a page; `number_of` returns our number of a page by viser's."""
        self._clients, self._make, self._number_of = clients, make, number_of
        self._parts: dict[int, Sequence[PagePart]] = {}

    def show(self, snapshot: Snapshot) -> None:
        """Show each page its own."""
        clients = {client.client_id: client for client in self._clients()}
        for gone in self._parts.keys() - clients.keys():
            del self._parts[gone]
        for number, client in clients.items():
            if number not in self._parts and not self._welcome(client):
                continue
            own = self._own(snapshot, number)
            for part in self._parts[number]:
                part.show(own)

    def _welcome(self, client: viser.ClientHandle) -> bool:
        """Make the parts of a page; return whether it is still there."""
        self._parts[client.client_id] = self._make(client)
        if any(each.client_id == client.client_id for each in self._clients()):
            return True
        # viser forgets what a page had when it left, and not what it gets afterwards.
        client.gui.reset()
        return False

    def _own(self, snapshot: Snapshot, client: int) -> Snapshot:
        page = self._number_of(client)
        inspection = None if page is None else snapshot.own_inspections.get(page)
        return snapshot if inspection is None else replace(snapshot, inspection=inspection)


class Painter:
    """Hands the newest snapshot to all layers and panels."""

    def __init__(self, parts: Sequence[PagePart], batch: "Batch") -> None:
        """Draw `parts`, in this order, each time within `batch()` so that the page applies it as one."""
        self._parts, self._batch = parts, batch
        self._change = threading.Condition()
        self._newest: Snapshot | None = None
        self._closing = False
        self._thread = threading.Thread(target=self._paint_forever, name="painter", daemon=True)

    def start(self) -> None:
        """Begin drawing."""
        self._thread.start()

    def publish(self, snapshot: Snapshot) -> None:
        """Take a snapshot to draw, in place of one that is still waiting. Never blocks for long."""
        with self._change:
            self._newest = snapshot
            self._change.notify()

    def paint(self, snapshot: Snapshot) -> None:
        """Draw one snapshot now; a part that fails is logged and does not keep the others from drawing."""
        with self._batch():
            for part in self._parts:
                try:
                    part.show(snapshot)
                except Exception:
                    logger.exception("%s could not be drawn", type(part).__name__)

    def close(self) -> None:
        """Stop drawing."""
        with self._change:
            self._closing = True
            self._change.notify()
        if self._thread.is_alive():
            self._thread.join(timeout=5.0)

    def _paint_forever(self) -> None:
        while (snapshot := self._next()) is not None:
            self.paint(snapshot)

    def _next(self) -> Snapshot | None:
        with self._change:
            self._change.wait_for(lambda: self._closing or self._newest is not None)
            snapshot, self._newest = self._newest, None
            return None if self._closing else snapshot


class Batch(Protocol):
    """Groups what is sent to the page, such as `viser.ViserServer.atomic`."""

    def __call__(self) -> AbstractContextManager[None]:
        """Begin a group."""
        ...
