"""The page behind a proxy: below a path it works; where it is refused, it says so and what to do."""

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Page, expect

from ltvn_viz.server.driver_seat import DriverSeat
from ltvn_viz.server.guarded_server import GuardedServer
from tests.browser.drive_page import FIELD, DrivePage, open_drive_page
from tests.browser.forwarder import forwarder
from tests.browser.pages import draw_nothing
from tests.waiting import PATIENCE_MS, until

pytestmark = pytest.mark.browser


@pytest.fixture
def door(chromium: Browser) -> Iterator[DrivePage]:
    with GuardedServer(seat=DriverSeat(lease_s=5.0)) as server, open_drive_page(server, chromium) as door:
        yield door


def open_at(door: DrivePage, address: str) -> Page:
    page = door.window.new_page()
    page.set_default_timeout(PATIENCE_MS)
    draw_nothing(page)
    page.goto(f"{address}#token={door.server.token}")
    return page


def test_below_a_path_the_page_drives_and_shows_its_pictures(door: DrivePage) -> None:
    fetched: list[int] = []
    door.server.add_route("/thumb/", lambda number: fetched.append(number))
    door.server.gui.add_html(f'<img alt="a node" src="{door.server.file_address("/thumb/17.jpg")}">')
    with forwarder(door.server.port) as address:
        page = open_at(door, address)
        page.locator(FIELD).wait_for()
        door.wait_until_armed(1)
        door.told.forget()
        door.hold(page)
        page.keyboard.up("w")
        door.told.next_stop()
        until(lambda: fetched == [17])


def test_a_page_whose_sockets_are_refused_says_what_to_do_instead(door: DrivePage) -> None:
    with forwarder(door.server.port, sets_host=True) as address:
        page = open_at(door, address)
        expect(page.get_by_role("status").filter(has_text="proxy")).to_contain_text("ssh -L")
