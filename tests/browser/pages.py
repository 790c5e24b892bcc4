"""A page in the browser for a test or a picture: opened, patient, and closed whatever happens."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import viser
import viser.transforms as vt
from playwright.sync_api import Browser, BrowserContext, Page

from tests.waiting import PATIENCE_MS, PATIENCE_S

_EMPTY = "about:blank"

_DRAW_NOTHING = """
for (const call of ["drawElements", "drawArrays", "drawElementsInstanced", "drawArraysInstanced"]) {
  WebGL2RenderingContext.prototype[call] = () => {};
}
"""


def draw_nothing(pages: BrowserContext | Page) -> None:
    """Leave the canvas of pages that are opened from now on empty; all else works, clicks on the scene among it.

    Without a graphics card the processor draws, which would leave little of it to the tests.
    """
    pages.add_init_script(_DRAW_NOTHING)


def keep_window(browser: Browser) -> None:
    """Open an empty window that stays: a window is as dear as the page in it, and `open_window` lends this one."""
    browser.new_context().new_page()


@contextmanager
def open_window(browser: Browser) -> Iterator[BrowserContext]:
    """Lend a window to open pages in, with nothing of earlier ones: the one that stays if it is empty, else a new one.

    Pages that are open at the end are closed.
    """
    kept = next((each for each in browser.contexts if [page.url for page in each.pages] == [_EMPTY]), None)
    window = kept or browser.new_context()
    try:
        yield window
    finally:
        if kept is None:
            window.close()
        else:
            for page in window.pages[1:]:
                page.close()
            window.clear_cookies()


@contextmanager
def open_page(browser: Browser, url: str, *, width: int, height: int, draws: bool = True) -> Iterator[Page]:
    """Open an address in a window of so many pixels, and close it at the end; see `draw_nothing`."""
    with open_window(browser) as window:
        page = window.new_page()
        page.set_viewport_size({"width": width, "height": height})
        if not draws:
            draw_nothing(page)
        page.set_default_timeout(PATIENCE_MS)
        page.goto(url)
        yield page


def wait_until_drawn(server: viser.ViserServer) -> viser.ClientHandle:
    """Wait until the only page of a server has drawn its scene, and return the server's end of it."""
    (client,) = server.get_clients().values()
    client.get_render(60, 80, timeout=PATIENCE_S)
    return client


def on_screen(server: viser.ViserServer, page: Page, point: np.ndarray) -> tuple[float, float]:
    """Return where a point (3,) of the scene, in metres, appears in the window, in pixels."""
    camera = wait_until_drawn(server).camera
    pose = vt.SE3.from_rotation_and_translation(vt.SO3(np.asarray(camera.wxyz)), np.asarray(camera.position))
    seen = pose.inverse().apply(point)
    focal = camera.image_height / 2 / np.tan(camera.fov / 2)
    box = page.locator("canvas").first.bounding_box()
    assert box is not None
    return (
        float(box["x"] + camera.image_width / 2 + focal * seen[0] / seen[2]),
        float(box["y"] + camera.image_height / 2 + focal * seen[1] / seen[2]),
    )
