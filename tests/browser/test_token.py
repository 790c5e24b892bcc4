"""The token of the link in a real browser: what keeps it, what asks for it, and who never gets it."""

import http.server
import json
import threading
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Page, expect

from ltvn_viz.server.driver_seat import DriverSeat
from ltvn_viz.server.guarded_server import GuardedServer
from tests.browser.drive_page import FIELD, DrivePage, open_drive_page
from tests.waiting import until

pytestmark = pytest.mark.browser


@pytest.fixture
def door(chromium: Browser) -> Iterator[DrivePage]:
    with GuardedServer(seat=DriverSeat(lease_s=5.0)) as server, open_drive_page(server, chromium) as door:
        yield door


@pytest.fixture
def foreign() -> Iterator[tuple[str, list[str]]]:
    """A server of somebody else on another port, and all that browsers send to it."""
    heard: list[str] = []

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            heard.append(f"{self.requestline}\n{self.headers}")
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(b"<title>foreign</title>")

        def log_message(self, format: str, *args: object) -> None:
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_address[1]}/", heard
        server.shutdown()
        thread.join()


def test_the_token_leaves_the_address_bar_and_a_reload_and_a_second_tab_still_drive(door: DrivePage) -> None:
    page = door.open()
    assert page.url == f"http://127.0.0.1:{door.server.port}/"

    page.reload()
    page.locator(FIELD).wait_for()
    door.wait_until_armed(next(door.clients))
    door.hold(page)
    page.keyboard.up("w")
    door.told.next_stop()

    second = door.open()
    second.get_by_role("button", name="take over").click()
    until(lambda: door.server.seat.state_of(3).driver == 3)


def test_a_server_on_another_port_gets_neither_cookie_nor_token(
    door: DrivePage, foreign: tuple[str, list[str]]
) -> None:
    address, heard = foreign
    page = door.open()
    page.evaluate("address => { location = address; }", address)
    page.wait_for_url(address)

    assert door.window.cookies() == []
    assert "referer" not in heard[0].lower()
    for request in heard:
        assert "cookie" not in request.lower()
        assert door.server.token not in request
    assert door.server.token not in page.evaluate("JSON.stringify({ ...sessionStorage, ...localStorage })")


def test_a_tab_without_the_token_asks_for_it_and_goes_on_to_what_its_address_asks_for(door: DrivePage) -> None:
    page = door.window.new_page()
    page.goto(f"http://127.0.0.1:{door.server.port}/?initialCameraUp=0,0,1")
    field = page.get_by_label("Paste the address")
    field.fill(door.server.url)
    page.locator(FIELD).wait_for()
    assert "initialCameraUp" in page.url
    expect(field).to_have_count(0)


def test_a_page_of_an_earlier_start_says_that_its_token_is_old(door: DrivePage) -> None:
    page = door.open()
    port, name = door.server.port, page.get_by_label("Paste the address")
    door.server.close()
    with GuardedServer(port=port) as again:
        again.gui.add_text("Name", initial_value="here")
        page.bring_to_front()
        name.wait_for()
        expect(page.get_by_text("started again")).to_be_visible()
        # viser's worker is gone, because it would knock again and again.
        until(lambda: len(page.workers) == 1, meanwhile=lambda: page.wait_for_timeout(100))
        _open_in_place(page, again.url)
        page.locator(FIELD).wait_for()


def _open_in_place(page: Page, link: str) -> None:
    """Type a link into the address bar of a page that differs from it by the fragment alone."""
    page.evaluate(f"location.href = {json.dumps(link)}")
