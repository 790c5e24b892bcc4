"""A page in the browser for a test or a picture: opened, patient, and closed whatever happens."""

from collections.abc import Iterator
from contextlib import contextmanager

import viser
from playwright.sync_api import Browser, BrowserContext, Page

from tests.waiting import PATIENCE_MS, PATIENCE_S, until

PLAN = "#ltvn-plan"
"""The map from above."""
_SHOW_3D = """
try { localStorage.setItem("ltvn-view", "3d"); } catch { /* A page without an address of its own. */ }
"""
_DRAW_SELDOM = """
requestAnimationFrame = (callback) => setTimeout(() => callback(performance.now()), EVERY_MS);
cancelAnimationFrame = clearTimeout;
"""
_DRAW_NOTHING = """
for (const call of ["drawElements", "drawArrays", "drawElementsInstanced", "drawArraysInstanced"]) {
  WebGL2RenderingContext.prototype[call] = () => {};
}
"""


def show_3d(pages: BrowserContext | Page) -> None:
    """Let pages that are opened from now on show the 3D scene, which a page drawn by the processor does on demand."""
    pages.add_init_script(_SHOW_3D)


def draw_seldom(pages: BrowserContext | Page, every_ms: int = 200) -> None:
    """Let pages that are opened from now on draw so seldom, five times a second if nothing else is said.

    Without a graphics card the processor draws, which would leave little of it to the tests.
    """
    pages.add_init_script(_DRAW_SELDOM.replace("EVERY_MS", str(every_ms)))


def draw_nothing(pages: BrowserContext | Page, every_ms: int = 200) -> None:
    """Leave the 3D canvas of pages that are opened from now on empty; all else works, the map from above among it."""
    draw_seldom(pages, every_ms)
    pages.add_init_script(_DRAW_NOTHING)


@contextmanager
def open_page(
    browser: Browser, url: str, *, width: int, height: int, draws: bool = True, scene: bool = False
) -> Iterator[Page]:
    """Open an address in a window of so many pixels, and close it at the end; see `draw_seldom` and `draw_nothing`.

    With `scene` the page shows the 3D scene in place of the map from above.

    The system asks for dark colours, as it does in the pictures of the documents.
    """
    page = browser.new_page(viewport={"width": width, "height": height}, color_scheme="dark")
    spare = draw_seldom if draws else draw_nothing
    spare(page)
    if scene:
        show_3d(page)
    page.set_default_timeout(PATIENCE_MS)
    try:
        page.goto(url)
        yield page
    finally:
        page.close()


def wait_until_drawn(page: Page) -> int:
    """Wait until a page has drawn the map from above as the app knows it, and return its number of nodes."""
    page.locator(f"{PLAN}[data-drawn]").wait_for(state="attached")
    return int(until(lambda: page.locator(PLAN).get_attribute("data-drawn")) or 0)


def wait_for_scene(server: viser.ViserServer) -> viser.ClientHandle:
    """Wait until the only page of a server has drawn its 3D scene, and return the server's end of it."""
    until(lambda: len(server.get_clients()) == 1, explain=server.get_clients)
    (client,) = server.get_clients().values()
    client.get_render(60, 80, timeout=PATIENCE_S)
    return client


def is_bare_map(page: Page, point: tuple[float, float]) -> bool:
    """Tell whether a click at a point of the window, in pixels, would meet the map and no panel, key or picture."""
    return page.evaluate(f"([x, y]) => document.elementFromPoint(x, y)?.matches('{PLAN}') ?? false", list(point))


def on_screen(page: Page, x: float, y: float) -> tuple[float, float]:
    """Return where a place of the map from above, in metres, appears in the window, in pixels."""
    wait_until_drawn(page)
    plan = page.locator(PLAN)
    eye, box = plan.get_attribute("data-eye"), plan.bounding_box()
    assert eye is not None
    assert box is not None
    eye_x, eye_y, scale = map(float, eye.split())
    return (
        box["x"] + box["width"] / 2 + (x - eye_x) * scale,
        box["y"] + box["height"] / 2 - (y - eye_y) * scale,
    )
