"""Presses on a page whose connection is lost, or whose panel is drawn anew: each is heard once, or the page says so."""

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Page, expect

from ltvn_viz.server.driver_seat import DriverSeat
from ltvn_viz.server.guarded_server import GuardedServer
from ltvn_viz.wishes.commands import Action
from tests.browser.drive_page import FIELD, DrivePage, open_drive_page
from tests.waiting import PATIENCE_S, until

pytestmark = pytest.mark.browser

RECORD = '[data-ltvn-action="record"]'
BUTTONS = """
<button type="button" data-ltvn-action="record">Record</button>
<button type="button" data-ltvn-action="build">Build</button>
"""
PRESS_WHILE_LOST = """
new MutationObserver((_, observer) => {
  if (!document.querySelector(".ltvn-status").textContent.startsWith("No connection")) return;
  observer.disconnect();
  document.body.dispatchEvent(new KeyboardEvent("keydown", { code: "KeyP", bubbles: true }));
  document.querySelector('[data-ltvn-action="record"]').click();
  document.querySelector('[data-ltvn-action="record"]').click();
}).observe(document.querySelector(".ltvn-status"), { childList: true, characterData: true, subtree: true });
"""


@pytest.fixture
def door(chromium: Browser) -> Iterator[DrivePage]:
    with GuardedServer(seat=DriverSeat(lease_s=5.0)) as server:
        server.gui.add_html(BUTTONS)
        with open_drive_page(server, chromium) as door:
            yield door


def open_page(door: DrivePage) -> Page:
    page = door.open()
    page.locator(RECORD).wait_for()
    return page


def cut_drive_sockets(server: GuardedServer) -> None:
    loop = server._drive._loop
    assert loop is not None
    for page in list(server._drive._pages.values()):
        loop.call_soon_threadsafe(page.connection.transport.abort)


def test_a_press_while_the_connection_is_lost_arrives_once_and_a_key_does_not(door: DrivePage) -> None:
    page = open_page(door)
    page.evaluate(PRESS_WHILE_LOST)
    cut_drive_sockets(door.server)
    assert door.told.actions.get(timeout=PATIENCE_S) == (Action.RECORD, None)
    page.get_by_role("button", name="Build").click()
    assert door.told.actions.get(timeout=PATIENCE_S) == (Action.BUILD, None)


def test_a_press_that_the_app_never_hears_is_said(door: DrivePage) -> None:
    page = open_page(door)
    door.server.close()
    expect(page.locator(".ltvn-status")).to_contain_text("No connection")
    page.locator(RECORD).press("Enter")
    expect(page.get_by_role("alert").filter(has_text="Record")).to_contain_text("not heard")


def test_while_viser_s_socket_is_lost_our_buttons_work_and_viser_s_controls_say_that_they_do_not(
    door: DrivePage,
) -> None:
    page = open_page(door)
    page.evaluate("document.hasFocus = () => false")  # viser connects again only while its window has the focus.
    door.server.viser._websock_server.disconnect_all_clients()
    until(lambda: not door.server.viser.get_clients())
    page.locator(RECORD).click()
    assert door.told.actions.get(timeout=PATIENCE_S) == (Action.RECORD, None)

    box = page.locator(FIELD).bounding_box()
    assert box is not None
    said = page.get_by_role("alert").filter(has_text="not heard")
    until(
        said.is_visible,
        meanwhile=lambda: page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2),
    )


def test_a_button_that_is_drawn_anew_under_a_press_is_pressed_once(door: DrivePage) -> None:
    page = open_page(door)
    page.locator(RECORD).hover()
    page.mouse.down()
    page.evaluate("(button) => { button.outerHTML = button.outerHTML; }", page.locator(RECORD).element_handle())
    page.mouse.up()
    page.get_by_role("button", name="Build").click()
    assert [door.told.actions.get(timeout=PATIENCE_S)[0] for _ in range(2)] == [Action.RECORD, Action.BUILD]
