"""Keys, pad and clicks on one real page: what the robot's end is told of them."""

import time
from collections.abc import Iterator

import numpy as np
import pytest
from playwright.sync_api import Browser, Page

from ltvn_viz.server.driver_seat import DriverSeat, StopReason
from ltvn_viz.server.guarded_server import GuardedServer
from ltvn_viz.wishes.commands import Action
from tests.browser.drive_page import FIELD, STOP_WITHIN_S, DrivePage, open_drive_page, quickest
from tests.waiting import PATIENCE_S, until

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def served(chromium: Browser) -> Iterator[tuple[DrivePage, Page]]:
    """A patient door with a page, which the tests leave as it was."""
    with GuardedServer(seat=DriverSeat(lease_s=5.0)) as server, open_drive_page(server, chromium) as door:
        yield door, door.open()


@pytest.fixture
def door_and_page(served: tuple[DrivePage, Page]) -> tuple[DrivePage, Page]:
    """The shared door, armed and with nothing held."""
    door, page = served
    page.evaluate("document.activeElement.blur()")
    door.wait_until_armed(1)
    door.told.forget()
    return door, page


def test_held_keys_drive_and_letting_go_stops_within_300_ms(door_and_page: tuple[DrivePage, Page]) -> None:
    door, page = door_and_page

    def drive_and_let_go() -> float:
        door.wait_until_armed(1)
        door.told.forget()
        page.keyboard.down("w")
        assert door.told.next_drive().linear_m_s > 0
        page.keyboard.down("ArrowLeft")
        both = door.told.next_drive()
        while both.angular_rad_s == 0:
            both = door.told.next_drive()
        assert both.linear_m_s > 0
        page.keyboard.up("ArrowLeft")
        released = time.monotonic()
        page.keyboard.up("w")
        stopped, reason = door.told.next_stop()
        assert reason is StopReason.RELEASED
        return stopped - released

    assert quickest(drive_and_let_go) <= STOP_WITHIN_S


def test_a_key_held_across_a_stop_drives_only_after_it_was_let_go(door_and_page: tuple[DrivePage, Page]) -> None:
    door, page = door_and_page
    door.hold(page)
    page.keyboard.press("Space")
    door.told.next_stop()
    page.get_by_text("release the keys to go on").wait_for()
    assert door.server.seat.current_twist() is None
    page.keyboard.up("w")
    door.wait_until_armed(1)
    door.hold(page)
    page.keyboard.up("w")
    door.told.next_stop()


def test_typing_drives_nothing(door_and_page: tuple[DrivePage, Page]) -> None:
    door, page = door_and_page
    page.locator(FIELD).click()
    door.told.forget()
    page.keyboard.type("wasd")
    until(lambda: "wasd" in door.field.value)
    assert door.told.drives.empty()
    assert door.told.actions.empty()


def test_a_button_that_is_drawn_anew_takes_no_held_key_away(door_and_page: tuple[DrivePage, Page]) -> None:
    door, page = door_and_page
    button = door.server.gui.add_button("Record")
    page.get_by_role("button", name="Record").focus()
    door.hold(page)
    button.remove()
    page.get_by_role("button", name="Record").wait_for(state="detached")
    for _ in range(20):
        door.told.next_drive()
    assert door.told.stops.empty()
    page.keyboard.up("w")
    door.told.next_stop()


def test_the_viewers_camera_stands_still_while_the_robot_drives(door_and_page: tuple[DrivePage, Page]) -> None:
    door, page = door_and_page
    until(lambda: len(door.server.viser.get_clients()) == 1)
    client = next(iter(door.server.viser.get_clients().values()))
    before = np.array(client.camera.position)
    door.hold(page)
    for _ in range(10):
        door.told.next_drive()
    page.keyboard.up("w")
    door.told.next_stop()
    assert np.allclose(client.camera.position, before, atol=1e-3)


def test_the_pad_drives_while_it_is_pressed(door_and_page: tuple[DrivePage, Page]) -> None:
    door, page = door_and_page
    box = page.get_by_role("button", name="drive forward").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.down()
    assert door.told.next_drive().linear_m_s > 0
    page.mouse.up()
    assert door.told.next_stop()[1] is StopReason.RELEASED


def test_a_clicked_image_and_a_pressed_key_reach_the_app(door_and_page: tuple[DrivePage, Page]) -> None:
    door, page = door_and_page
    door.server.gui.add_html('<b data-ltvn-action="goal" data-id="17">a picture</b>')
    page.get_by_text("a picture").click()
    assert door.told.actions.get(timeout=PATIENCE_S) == (Action.GOAL, 17)
    page.keyboard.press("r")
    assert door.told.actions.get(timeout=PATIENCE_S) == (Action.RECORD, None)
