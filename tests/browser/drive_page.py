"""A door with pages on it and nothing behind it: what the server would tell the app is kept, with its time."""

import itertools
import math
import queue
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from dataclasses import field as dataclass_field

import psutil
import viser
from playwright.sync_api import Browser, BrowserContext, Page

from ltvn_core.types import Twist
from ltvn_viz.panels.status_panel import PANEL_MARK
from ltvn_viz.server.drive_socket import DriveListener
from ltvn_viz.server.driver_seat import StopReason
from ltvn_viz.server.guarded_server import GuardedServer
from ltvn_viz.wishes.commands import Action, Value
from tests.browser.pages import draw_nothing
from tests.waiting import PATIENCE_MS, PATIENCE_S, until

FIELD = "input[value=here]"
"""A field to type in."""

STOP_WITHIN_S = 0.3
TRIES = 8
"""On a machine that has other things to do, any single stop may be late: the quickest of a few counts."""


@dataclass
class ReceivedInput:
    """What the app was told, each thing with its time."""

    drives: "queue.Queue[tuple[float, Twist]]" = dataclass_field(default_factory=queue.Queue)
    stops: "queue.Queue[tuple[float, StopReason]]" = dataclass_field(default_factory=queue.Queue)
    actions: "queue.Queue[tuple[Action, Value]]" = dataclass_field(default_factory=queue.Queue)

    def listener(self) -> DriveListener:
        return DriveListener(
            on_drive=lambda twist: self.drives.put((time.monotonic(), twist)),
            on_stop=lambda reason: self.stops.put((time.monotonic(), reason)),
            on_command=lambda asked: self.actions.put((asked.action, asked.value)),
        )

    def forget(self) -> None:
        for told in (self.drives, self.stops, self.actions):
            while not told.empty():
                told.get_nowait()

    def next_stop(self) -> tuple[float, StopReason]:
        return self.stops.get(timeout=PATIENCE_S)

    def next_drive(self) -> Twist:
        return self.drives.get(timeout=PATIENCE_S)[1]


@dataclass(frozen=True)
class DrivePage:
    """A server, what it told, and pages on it."""

    server: GuardedServer
    told: ReceivedInput
    window: BrowserContext
    field: viser.GuiInputHandle[str]
    clients: "itertools.count[int]" = dataclass_field(default_factory=lambda: itertools.count(1))

    def open(self) -> Page:
        """Open a page and wait until it may drive."""
        page = self.window.new_page()
        page.set_viewport_size({"width": 800, "height": 500})
        page.set_default_timeout(PATIENCE_MS)
        draw_nothing(page)
        page.goto(self.server.url)
        page.locator(FIELD).wait_for()
        self.wait_until_armed(next(self.clients))
        self.told.forget()
        return page

    def wait_until_armed(self, client: int) -> None:
        """Wait until an input of this client, who is counted from 1, would move the robot."""
        until(lambda: self.server.seat.state_of(client).is_armed)

    def hold(self, page: Page, key: str = "w") -> None:
        """Hold a key and wait until the robot is told to move."""
        page.bring_to_front()
        page.keyboard.down(key)
        self.told.next_drive()


@contextmanager
def open_drive_page(server: GuardedServer, chromium: Browser) -> Iterator[DrivePage]:
    """Put a thing and a field on the pages of a server, and keep what it tells."""
    told = ReceivedInput()
    server.listen(told.listener())
    server.scene.add_box("/thing", dimensions=(1.0, 1.0, 1.0), cast_shadow=False)
    server.gui.add_html(PANEL_MARK)
    field = server.gui.add_text("Name", initial_value="here")
    window = chromium.new_context()
    yield DrivePage(server, told, window, field)
    window.close()


def quickest(seconds_to_stop: Callable[[], float]) -> float:
    """Return the shortest of a few times to stop; no more are taken once one is short enough."""
    took = math.inf
    for _ in range(TRIES):
        took = min(took, seconds_to_stop())
        if took <= STOP_WITHIN_S:
            break
    return took


def renderers() -> list[psutil.Process]:
    """Return the browser's processes that show pages."""
    return [process for process in psutil.Process().children(recursive=True) if _shows_a_page(process)]


def _shows_a_page(process: psutil.Process) -> bool:
    try:
        return process.status() != psutil.STATUS_ZOMBIE and "--type=renderer" in " ".join(process.cmdline())
    except psutil.NoSuchProcess:  # It ended as one looked.
        return False
