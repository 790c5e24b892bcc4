"""A page in the browser for a test or a picture: opened, patient, and closed whatever happens."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import viser
import viser.transforms as vt
from playwright.sync_api import Browser, BrowserContext, Page

from tests.waiting import PATIENCE_MS, PATIENCE_S, until

_DRAW_FULLY = """
try { localStorage.setItem("ltvn-drawing", "full"); } catch { /* A page without an address of its own. */ }
"""
_DRAW_SELDOM = """
requestAnimationFrame = (callback) => setTimeout(() => callback(performance.now()), 200);
cancelAnimationFrame = clearTimeout;
"""
_DRAW_NOTHING = """
for (const call of ["drawElements", "drawArrays", "drawElementsInstanced", "drawArraysInstanced"]) {
  WebGL2RenderingContext.prototype[call] = () => {};
}
"""


def draw_fully(pages: BrowserContext | Page) -> None:
    """Let pages that are opened from now on draw all there is, however slowly this machine does."""
    pages.add_init_script(_DRAW_FULLY)


def draw_seldom(pages: BrowserContext | Page) -> None:
    """Let pages that are opened from now on draw five times a second.

    Without a graphics card the processor draws, which would leave little of it to the tests.
    """
    draw_fully(pages)
    pages.add_init_script(_DRAW_SELDOM)


def draw_nothing(pages: BrowserContext | Page) -> None:
    """Leave the canvas of pages that are opened from now on empty; all else works, clicks on the scene among it."""
    draw_seldom(pages)
    pages.add_init_script(_DRAW_NOTHING)


@contextmanager
def open_page(browser: Browser, url: str, *, width: int, height: int, draws: bool = True) -> Iterator[Page]:
    """Open an address in a window of so many pixels, and close it at the end; see `draw_seldom` and `draw_nothing`.

    The system asks for dark colours, as it does in the pictures of the documents.
    """
    page = browser.new_page(viewport={"width": width, "height": height}, color_scheme="dark")
    spare = draw_seldom if draws else draw_nothing
    spare(page)
    page.set_default_timeout(PATIENCE_MS)
    try:
        page.goto(url)
        yield page
    finally:
        page.close()


def wait_until_drawn(server: viser.ViserServer) -> viser.ClientHandle:
    """Wait until the only page of a server has drawn its scene, and return the server's end of it."""
    until(lambda: len(server.get_clients()) == 1, explain=server.get_clients)
    (client,) = server.get_clients().values()
    client.get_render(60, 80, timeout=PATIENCE_S)
    return client


def is_bare_scene(page: Page, point: tuple[float, float]) -> bool:
    """Tell whether a click at a point of the window, in pixels, would meet the scene and no panel, pad or picture."""
    return page.evaluate("([x, y]) => document.elementFromPoint(x, y)?.tagName === 'CANVAS'", list(point))


def on_screen(server: viser.ViserServer, page: Page, point: np.ndarray) -> tuple[float, float]:
    """Return where a point (3,) of the scene, in metres, appears in the window, in pixels."""
    camera = wait_until_drawn(server).camera
    pose = vt.SE3.from_rotation_and_translation(vt.SO3(np.asarray(camera.wxyz)), np.asarray(camera.position))
    seen = pose.inverse().apply(point)
    focal = camera.image_height / 2 / np.tan(camera.fov / 2)
    box = page.locator("canvas[data-engine]").bounding_box()
    assert box is not None
    return (
        float(box["x"] + camera.image_width / 2 + focal * seen[0] / seen[2]),
        float(box["y"] + camera.image_height / 2 + focal * seen[1] / seen[2]),
    )
