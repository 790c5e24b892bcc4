"""The `/drive` socket: carries held inputs and presses to the app, and seat and camera pictures back to the pages.

Owns the connections and the watchdog thread. The rules of driving are in `driver_seat.py`, the messages in
`drive_messages.py`. The listener is called directly when a message arrives, without any `await` in between.
"""

import asyncio
import itertools
import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, auto

from websockets.exceptions import ConnectionClosed
from websockets.frames import CloseCode

from ltvn_core.types import Twist
from ltvn_viz.server.drive_messages import (
    BEAT_MESSAGE,
    MAX_MESSAGE_BYTES,
    DriveMessage,
    HereMessage,
    LinkMessage,
    MessageError,
    PageMessage,
    ViewMessage,
    parse_message,
    refusal_message,
    state_message,
)
from ltvn_viz.server.driver_seat import TICK_S, ClientId, DriveAccepted, DriverSeat, HeldInput, Presence, StopReason
from ltvn_viz.server.limits import GuardedConnection, LimitedLog, Pace, PageBudget
from ltvn_viz.wishes.commands import Ask
from ltvn_viz.wishes.wish import Audience
from ltvn_viz.wishes.wish_table import Action

logger = logging.getLogger(__name__)

MAX_PAGES = 32
MAX_UNSENT = 16
BEAT_S = 0.25
"""Interval between signs of life to each page, in seconds; a page that gets none for a second reports outdated
content."""


@dataclass(frozen=True, slots=True)
class DriveListener:
    """Callbacks of the drive socket. The server's or the watchdog's thread calls them, one at a time; they must not
    block."""

    on_drive: Callable[[Twist], None] = lambda twist: None
    """Called when the driver's input was accepted; repeated at 20 Hz while it is held."""
    on_stop: Callable[[StopReason], None] = lambda reason: None
    """Called when the motion ended, or a person pressed stop."""
    on_command: Callable[[Ask], None] = lambda command: None
    """Called when an action was requested by a key or a click."""
    on_link: Callable[[str], None] = lambda query: None
    """Called when a page was opened by a link with this query."""
    on_absence: Callable[[], None] = lambda: None
    """Called when the last page is gone."""


class Newest(Enum):
    """Kinds of messages of which a page needs only the newest; sent in this order."""

    PICTURE = auto()
    """What the method sees, a JPEG."""
    LARGER = auto()
    """A byte 0, and the larger picture as a JPEG if there is one; sent to pages that show it."""
    MOMENT = auto()
    """The moment on show."""
    ACTIVITY = auto()
    """The robot's current activity."""
    ROBOT = auto()
    """The robot's pose."""
    VIEW = auto()
    """The plan view, except what has a message of its own."""
    PATH = auto()
    """The path that was driven."""
    COURSE = auto()
    """The whole path of the open recording."""
    BEAT = auto()
    """A sign of life of the server."""


class _Page:
    """One open page: its connection and the messages waiting for it."""

    def __init__(self, client: ClientId, connection: GuardedConnection) -> None:
        self.client = client
        self.connection = connection
        self.shows = ViewMessage(scene=False, camera=False)
        self._told = ""
        self._unsent: list[str] = []
        self._newest: dict[Newest, str | bytes] = {}
        self._wake = asyncio.Event()

    def tell_state(self, message: str) -> None:
        if message != self._told:
            self._told = message
            self.tell(message)

    def tell(self, message: str) -> None:
        # A page that stops reading gets only the newest messages when it reads again.
        self._unsent = [*self._unsent[-MAX_UNSENT + 1 :], message]
        self._wake.set()

    def tell_newest(self, kind: Newest, message: str | bytes) -> None:
        # A page that stops reading gets only the newest message of each kind.
        if kind is not Newest.LARGER or self.shows.camera:
            self._newest[kind] = message
            self._wake.set()

    async def send_forever(self) -> None:
        while True:
            await self._wake.wait()
            self._wake.clear()
            unsent, self._unsent = self._unsent, []
            for message in unsent:
                await self.connection.send(message)
            for kind in Newest:
                if (newest := self._newest.pop(kind, None)) is not None:
                    await self.connection.send(newest)


class DriveSocket:
    """Serves the drive connections of the pages and passes the driver's requests to the listener."""

    def __init__(
        self,
        seat: DriverSeat,
        presence: Presence | None = None,
        *,
        pace: Pace | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Serve pages whose messages stay within the limits of `pace`."""
        self._pace = pace or Pace()
        self.seat = seat
        self.presence = presence or Presence()
        self.listener = DriveListener()
        self._clock = clock
        self._ids = itertools.count(1)
        self._pages: dict[ClientId, _Page] = {}
        self._loop: asyncio.AbstractEventLoop | None = None
        self._telling = threading.RLock()
        self._wake = threading.Event()
        self._closing = False
        self._clients: dict[str, ClientId] = {}
        self._newest: dict[Newest, str | bytes] = {}
        self._stop_log = LimitedLog(logger)
        self._refusal_log = LimitedLog(logger)
        self._watchdog = threading.Thread(target=self._watch, name="drive watchdog", daemon=True)
        self._watchdog.start()

    async def serve(self, connection: GuardedConnection, key: str | None = None) -> None:
        """Serve one page until it disconnects or sends an invalid message; its other socket has the same key."""
        if len(self._pages) >= MAX_PAGES:
            await connection.close(CloseCode.TRY_AGAIN_LATER, "too many pages")
            return
        if self._loop is None:
            self._loop = asyncio.get_running_loop()
            self._watch_presence(self._loop)
            self._beat(self._loop)
        page = _Page(next(self._ids), connection)
        self._pages[page.client] = page
        self.presence.hear(page.client)
        if key is not None:
            self._clients[key] = page.client
        for kind, message in self._newest.copy().items():
            page.tell_newest(kind, message)
        sender = asyncio.create_task(page.send_forever())
        try:
            self._tell_pages()
            budget = PageBudget(self._pace)
            async for text in connection:
                budget.count(text)
                if len(text) > MAX_MESSAGE_BYTES:
                    raise MessageError(f"{len(text)} bytes; at most {MAX_MESSAGE_BYTES} would be valid")
                self._obey(page, parse_message(text))
        except MessageError as error:
            self._refusal_log.log(logging.WARNING, "closed the drive socket of page %d: %s", page.client, error)
            await connection.hang_up(error.told)
        except ConnectionClosed:
            pass
        finally:
            sender.cancel()
            del self._pages[page.client]
            if key is not None and self._clients.get(key) == page.client:
                del self._clients[key]
            self.seat.leave(page.client)
            self.presence.leave(page.client)
            self.settle()
            self._tell_absence()
            await asyncio.gather(sender, return_exceptions=True)

    @property
    def shown(self) -> ViewMessage:
        """What any page shows."""
        shown = [page.shows for page in list(self._pages.values())]
        return ViewMessage(any(each.scene for each in shown), any(each.camera for each in shown))

    def client_of(self, key: str | None) -> ClientId | None:
        """Return the page with a key; None if its drive socket is not open."""
        return None if key is None else self._clients.get(key)

    def may_drive(self, key: str | None) -> bool:
        """Give the seat to the page with a key if it is free; return whether the page has it, and notify it if not."""
        client = self.client_of(key)
        if client is None:
            return False
        may = self._sits(self._pages[client])
        self.settle()
        return may

    def settle(self) -> None:
        """Report changes of the seat to the listener and the pages. Safe from any thread."""
        # Events are taken and reported under one lock, so that they are reported in their order.
        with self._telling:
            for event in self.seat.take_events():
                if isinstance(event, DriveAccepted):
                    self._call(self.listener.on_drive, event.twist)
                else:
                    # Without a drive socket there is no robot, so its stop is not worth a line in the log.
                    level = logging.INFO if self._loop is not None else logging.DEBUG
                    self._stop_log.log(level, "robot stopped: %s (page %s)", event.reason, event.client)
                    self._call(self.listener.on_stop, event.reason)
        self._wake.set()
        if self._loop is not None and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._tell_pages)

    def tell_newest(self, kind: Newest, message: str | bytes) -> None:
        """Send a message to all pages, in place of any waiting message of its kind. Safe from any thread."""
        self._newest[kind] = message
        if self._loop is not None and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._tell_newest, kind, message)

    def close(self) -> None:
        """Stop the robot and end the watchdog."""
        self._closing = True
        self.seat.stop()
        self.settle()
        self._watchdog.join(timeout=1.0)

    def _obey(self, page: _Page, message: PageMessage) -> None:
        match message:
            case HereMessage():
                self.presence.hear(page.client)
                return
            case ViewMessage():
                page.shows = message
                if (larger := self._newest.get(Newest.LARGER)) is not None:
                    page.tell_newest(Newest.LARGER, larger)
                return
            case DriveMessage(held, stick, slow, epoch, age_ms):
                self.seat.receive(page.client, HeldInput(held, stick, slow), epoch, age_ms / 1000)
            case Ask(Action.STOP):
                self.seat.stop(page.client)
            case Ask(Action.TAKE_OVER):
                self.seat.take_over(page.client)
            case Ask(Action.RELEASE):
                self.seat.release(page.client)
            case Ask(action):
                if action.wish.audience is Audience.EVERYBODY or self._sits(page):
                    self._call(self.listener.on_command, message)
            case LinkMessage(query):
                if self._sits(page):
                    self._call(self.listener.on_link, query)
        self.settle()

    def _sits(self, page: _Page) -> bool:
        """Return whether a page has the seat, which it takes if it is free; if not, tell the page which one has it."""
        if self.seat.try_sit(page.client):
            return True
        driver = self.seat.state_of(page.client).driver
        if driver is not None:
            page.tell(refusal_message(driver))
        return False

    def _tell_newest(self, kind: Newest, message: str | bytes) -> None:
        for page in list(self._pages.values()):
            page.tell_newest(kind, message)

    def _tell_pages(self) -> None:
        for page in list(self._pages.values()):
            page.tell_state(state_message(page.client, self.seat.state_of(page.client)))

    def _call(self, callback: Callable[..., None], *arguments: object) -> None:
        # An error of the app must not end the socket or the watchdog.
        try:
            callback(*arguments)
        except Exception:
            logger.exception("the app failed to enqueue a command of a page")

    def _watch_presence(self, loop: asyncio.AbstractEventLoop) -> None:
        """Check for silent pages in the thread that receives their messages, so that its stalls do not count."""
        if self.presence.tick():
            self._tell_absence()
        if not self._closing:
            loop.call_later(TICK_S, self._watch_presence, loop)

    def _beat(self, loop: asyncio.AbstractEventLoop) -> None:
        self._tell_newest(Newest.BEAT, BEAT_MESSAGE)
        if not self._closing:
            loop.call_later(BEAT_S, self._beat, loop)

    def _tell_absence(self) -> None:
        if self.presence.absence is not None:
            self._call(self.listener.on_absence)

    def _watch(self) -> None:
        """Handle expired inputs in a separate thread, so that a hung server thread cannot keep the robot moving."""
        while not self._closing:
            deadline = self.seat.next_deadline()
            self._wake.wait(None if deadline is None else max(0.0, deadline - self._clock()))
            if self._wake.is_set():
                self._wake.clear()
            else:
                self.settle()
