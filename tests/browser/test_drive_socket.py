"""Driving through the door in a real browser: everything that must stop the robot, and who may drive.

The robot's end is a queue of what the server told the app, with the times at which it did.
"""

import contextlib
import math
import queue
import signal
import time
from collections.abc import Callable, Iterator

import psutil
import pytest
from playwright.sync_api import Browser, Page

from ltvn_viz.server.driver_seat import DriverSeat, StopReason
from ltvn_viz.server.guarded_server import GuardedServer
from tests.browser.drive_page import FIELD, STOP_WITHIN_S, DrivePage, open_drive_page, quickest, renderers
from tests.browser.pages import draw_nothing
from tests.waiting import PATIENCE_S, until

pytestmark = pytest.mark.browser


@pytest.fixture
def door(chromium: Browser) -> Iterator[DrivePage]:
    """A door with the lease of a real one, for tests of how soon the robot stops."""
    with GuardedServer() as server, open_drive_page(server, chromium) as door:
        yield door


@pytest.fixture
def patient_door(chromium: Browser) -> Iterator[DrivePage]:
    """A door for tests of anything else: a page drawn by software may stall for longer than the real lease."""
    with GuardedServer(seat=DriverSeat(lease_s=5.0)) as server, open_drive_page(server, chromium) as door:
        yield door


@pytest.mark.parametrize(
    "lose",
    [
        pytest.param(
            lambda page: page.evaluate("window.dispatchEvent(new Event('blur'))"), id="the window loses focus"
        ),
        pytest.param(lambda page: page.goto("about:blank"), id="the page is left"),
        pytest.param(lambda page: page.close(), id="the tab is closed"),
        pytest.param(
            lambda page: page.evaluate(f"document.querySelector('{FIELD}').focus()"), id="a text field gets focus"
        ),
        pytest.param(lambda page: page.keyboard.press("Space"), id="Space is pressed"),
        pytest.param(lambda page: [process.kill() for process in renderers()], id="the page is killed"),
        pytest.param(
            lambda page: [process.send_signal(signal.SIGSTOP) for process in renderers()], id="the page freezes"
        ),
    ],
)
def test_the_robot_stops_within_300_ms_when(door: DrivePage, lose: Callable[[Page], object]) -> None:
    def drive_and_lose() -> float:
        page = door.open()
        door.hold(page)
        begun = time.monotonic()
        try:
            lose(page)
            stopped, _ = door.told.next_stop()
        finally:
            for process in renderers():
                with contextlib.suppress(psutil.Error):
                    process.send_signal(signal.SIGCONT)
            page.close()
        # A page that stalled for longer than the lease had lost the robot before.
        return stopped - begun if stopped >= begun else math.inf

    assert quickest(drive_and_lose) <= STOP_WITHIN_S


def test_a_hidden_page_stops_the_robot(patient_door: DrivePage) -> None:
    page = patient_door.open()
    patient_door.hold(page)
    page.evaluate(
        "Object.defineProperty(document, 'hidden', {value: true});document.dispatchEvent(new Event('visibilitychange'))"
    )
    assert patient_door.told.next_stop()[1] is StopReason.RELEASED


def test_a_page_that_thaws_with_the_key_still_down_does_not_start_the_robot_again(door: DrivePage) -> None:
    page = door.open()
    door.hold(page)
    frozen = renderers()
    for process in frozen:
        process.send_signal(signal.SIGSTOP)
    assert door.told.next_stop()[1] is StopReason.INPUT_LOST
    door.told.forget()
    for process in frozen:
        process.send_signal(signal.SIGCONT)
    page.get_by_text("Input lost: release the keys to go on").wait_for()
    assert door.told.drives.empty()
    page.keyboard.up("w")
    door.wait_until_armed(1)
    assert door.told.drives.empty()
    door.hold(page)


def test_a_page_that_is_busy_keeps_its_hold_but_never_for_longer_than_the_limit(chromium: Browser) -> None:
    lease_s, hand_limit_s = 1.2, 3.0
    be_busy = "(seconds) => { const end = performance.now() + 1000 * seconds; while (performance.now() < end); }"
    seat = DriverSeat(lease_s=lease_s, hand_limit_s=hand_limit_s)
    with GuardedServer(seat=seat) as server, open_drive_page(server, chromium) as door:
        page = door.open()
        door.hold(page)
        page.evaluate(be_busy, 1.5 * lease_s)
        door.told.next_drive()
        assert door.told.stops.empty()
        page.evaluate(be_busy, 1.5 * hand_limit_s)
        free_again = time.monotonic()
        stopped, reason = door.told.next_stop()
        assert (reason, stopped < free_again) == (StopReason.INPUT_LOST, True)


def test_a_hung_server_thread_cannot_keep_the_robot_moving(door: DrivePage) -> None:
    def drive_and_hang() -> float:
        page = door.open()
        door.hold(page)
        hung, go_on = queue.Queue[None](), queue.Queue[None]()

        def hang() -> None:
            hung.put(None)
            go_on.get(timeout=PATIENCE_S)

        loop = door.server._drive._loop
        assert loop is not None
        loop.call_soon_threadsafe(hang)
        hung.get(timeout=PATIENCE_S)
        begun = time.monotonic()
        try:
            stopped, reason = door.told.next_stop()
        finally:
            go_on.put(None)
        page.close()
        assert reason is StopReason.INPUT_LOST
        return stopped - begun if stopped >= begun else math.inf

    assert quickest(drive_and_hang) <= STOP_WITHIN_S


def test_of_two_browsers_one_drives_and_both_may_stop(patient_door: DrivePage, chromium: Browser) -> None:
    ann = patient_door.open()
    other = chromium.new_context(viewport={"width": 800, "height": 500})
    draw_nothing(other)
    bob = other.new_page()
    bob.goto(patient_door.server.url)
    patient_door.wait_until_armed(2)
    patient_door.hold(ann)
    bob.keyboard.down("w")
    bob.get_by_text("drives: take over first").wait_for()
    assert patient_door.server.seat.state_of(1).driver == 1
    bob.keyboard.up("w")
    bob.keyboard.press("Space")
    assert patient_door.told.next_stop()[1] is StopReason.STOPPED
    assert patient_door.server.seat.current_twist() is None
    ann.keyboard.up("w")
    bob.get_by_role("button", name="take over driving").click()
    until(lambda: patient_door.server.seat.state_of(2).driver == 2)
    patient_door.wait_until_armed(2)
    patient_door.told.forget()
    patient_door.hold(bob)
    other.close()
