"""Driving through the door in a real browser: what moves the robot, everything that must stop it, and who may drive.

The robot's end is a queue of what the server told the app, with the times at which it did.
"""

import contextlib
import math
import queue
import signal
import time
from collections.abc import Callable, Iterator

import numpy as np
import psutil
import pytest
from playwright.sync_api import Browser, Page

from ltvn_viz.server.driver_seat import DriverSeat, StopReason
from ltvn_viz.server.guarded_server import GuardedServer
from ltvn_viz.server.keymap import Action
from tests.browser.drive_page import FIELD, DrivePage, open_drive_page, renderers
from tests.browser.pages import draw_nothing
from tests.waiting import PATIENCE_S, until

pytestmark = pytest.mark.browser

STOP_WITHIN_S = 0.3
TRIES = 8
"""On a machine that has other things to do, any single stop may be late: the quickest of a few counts."""


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


def quickest(seconds_to_stop: Callable[[], float]) -> float:
    """Return the shortest of a few times to stop; no more are taken once one is short enough."""
    took = math.inf
    for _ in range(TRIES):
        took = min(took, seconds_to_stop())
        if took <= STOP_WITHIN_S:
            break
    return took


def test_held_keys_drive_and_letting_go_stops_within_300_ms(patient_door: DrivePage) -> None:
    page = patient_door.open()

    def drive_and_let_go() -> float:
        patient_door.wait_until_armed(1)
        patient_door.told.forget()
        page.keyboard.down("w")
        assert patient_door.told.next_drive().linear_m_s > 0
        page.keyboard.down("ArrowLeft")
        both = patient_door.told.next_drive()
        while both.angular_rad_s == 0:
            both = patient_door.told.next_drive()
        assert both.linear_m_s > 0
        page.keyboard.up("ArrowLeft")
        released = time.monotonic()
        page.keyboard.up("w")
        stopped, reason = patient_door.told.next_stop()
        assert reason is StopReason.RELEASED
        return stopped - released

    assert quickest(drive_and_let_go) <= STOP_WITHIN_S


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


def test_a_key_held_across_a_stop_drives_only_after_it_was_let_go(patient_door: DrivePage) -> None:
    page = patient_door.open()
    patient_door.hold(page)
    patient_door.server.stop_robot()
    patient_door.told.next_stop()
    page.get_by_text("release the keys to go on").wait_for()
    assert patient_door.server.seat.current_twist() is None
    page.keyboard.up("w")
    patient_door.wait_until_armed(1)
    patient_door.hold(page)


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


def test_typing_drives_nothing(patient_door: DrivePage) -> None:
    page = patient_door.open()
    page.locator(FIELD).click()
    patient_door.told.forget()
    page.keyboard.type("wasd")
    until(lambda: "wasd" in patient_door.field.value)
    assert patient_door.told.drives.empty()
    assert patient_door.told.actions.empty()


def test_a_button_that_is_drawn_anew_takes_no_held_key_away(patient_door: DrivePage) -> None:
    button = patient_door.server.gui.add_button("Record")
    page = patient_door.open()
    page.get_by_role("button", name="Record").focus()
    patient_door.hold(page)
    button.remove()
    page.get_by_role("button", name="Record").wait_for(state="detached")
    for _ in range(20):
        patient_door.told.next_drive()
    assert patient_door.told.stops.empty()


def test_the_viewers_camera_stands_still_while_the_robot_drives(patient_door: DrivePage) -> None:
    page = patient_door.open()
    until(lambda: len(patient_door.server.viser.get_clients()) == 1)
    client = next(iter(patient_door.server.viser.get_clients().values()))
    before = np.array(client.camera.position)
    patient_door.hold(page)
    for _ in range(10):
        patient_door.told.next_drive()
    page.keyboard.up("w")
    patient_door.told.next_stop()
    assert np.allclose(client.camera.position, before, atol=1e-3)


def test_the_pad_drives_while_it_is_pressed(patient_door: DrivePage) -> None:
    page = patient_door.open()
    box = page.get_by_role("button", name="drive forward").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.down()
    assert patient_door.told.next_drive().linear_m_s > 0
    page.mouse.up()
    assert patient_door.told.next_stop()[1] is StopReason.RELEASED


def test_a_clicked_image_and_a_pressed_key_reach_the_app(patient_door: DrivePage) -> None:
    patient_door.server.gui.add_html('<b data-ltvn-action="goal" data-id="17">a picture</b>')
    page = patient_door.open()
    page.get_by_text("a picture").click()
    assert patient_door.told.actions.get(timeout=PATIENCE_S) == (Action.GOAL, 17)
    page.keyboard.press("r")
    assert patient_door.told.actions.get(timeout=PATIENCE_S) == (Action.RECORD, None)
