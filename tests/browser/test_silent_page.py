"""A page whose app fell silent: everything stays where it was, and the stop key stays red."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest
from playwright.sync_api import Browser, Page, expect

from ltvn_viz.server.driver_seat import DriverSeat
from ltvn_viz.server.guarded_server import GuardedServer
from tests.browser.drive_page import DrivePage, open_drive_page
from tests.waiting import PATIENCE_S

pytestmark = pytest.mark.browser

PARTS = (
    "#root .mantine-Paper-root:has([data-ltvn-panel])",
    "#root canvas",
    "#ltvn-cockpit",
    ".ltvn-pad",
    ".ltvn-pad .ltvn-stop",
    "#timeline-dock",
)
"""What must not move: panel, scene, robot, pad, stop key and timeline."""
LOOK = """
selectors => selectors.map(selector => {
  const { x, y, width, height } = document.querySelector(selector).getBoundingClientRect();
  return [selector, x, y, width, height];
})
"""
LOOK_AT_REST = f"""
async selectors => {{
  const look = {LOOK};
  let [last, frames] = ["", 0];
  while (frames < 10) {{
    await new Promise(requestAnimationFrame);
    const now = JSON.stringify(look(selectors));
    [last, frames] = [now, now === last ? frames + 1 : 0];
  }}
  return JSON.parse(last);
}}
"""
"""What a page of a new size shows once it has drawn: the timeline takes its height a frame after the window."""
FADES = """
() => {
  const found = [];
  for (let part = document.querySelector(".ltvn-pad .ltvn-stop"); part !== null; part = part.parentElement) {
    const { filter, opacity } = getComputedStyle(part);
    if (filter !== "none" || opacity !== "1") found.push(part.id || part.className);
  }
  return found;
}
"""


@pytest.fixture
def door(chromium: Browser) -> Iterator[DrivePage]:
    with GuardedServer(seat=DriverSeat(lease_s=5.0)) as server, open_drive_page(server, chromium) as door:
        yield door


@contextmanager
def frozen(door: DrivePage, page: Page) -> Iterator[None]:
    """Let the thread that serves all pages hang."""
    goes_on = threading.Event()
    loop = door.server._drive._loop
    assert loop is not None
    loop.call_soon_threadsafe(goes_on.wait, PATIENCE_S)
    try:
        yield
    finally:
        goes_on.set()


@contextmanager
def offline(door: DrivePage, page: Page) -> Iterator[None]:
    """Cut the browser off."""
    door.window.set_offline(True)
    door.server.viser.stop()
    yield


@contextmanager
def ended(door: DrivePage, page: Page) -> Iterator[None]:
    """End the app."""
    door.server.close()
    yield


@pytest.mark.parametrize("size", [(1400, 900), (900, 600), (420, 800)], ids=["wide", "medium", "narrow"])
@pytest.mark.parametrize("state", [frozen, offline, ended])
def test_nothing_moves_when_the_app_falls_silent(door: DrivePage, state: Callable, size: tuple[int, int]) -> None:
    page = door.open()
    page.set_viewport_size({"width": size[0], "height": size[1]})
    expect(page.locator("html[data-ltvn-ready]")).to_have_count(1)
    page.wait_for_function("() => document.querySelector('#root canvas') !== null")
    before = page.evaluate(LOOK_AT_REST, PARTS)
    with state(door, page):
        expect(page.locator("html[data-ltvn-silent]")).to_have_count(1)
        assert page.evaluate(LOOK, PARTS) == before
        assert page.evaluate(FADES) == []
