"""A page in the browser for a test or a picture: opened, patient, and closed whatever happens."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import viser
import viser.transforms as vt
from playwright.sync_api import Browser, BrowserContext, Page

from tests.waiting import PATIENCE_MS, PATIENCE_S

_FRAME_MS = 120
_FEW_FRAMES = f"""
const draw = window.requestAnimationFrame.bind(window);
window.requestAnimationFrame = (callback) => setTimeout(() => draw(callback), {_FRAME_MS});
window.cancelAnimationFrame = clearTimeout;
"""


def draw_few_frames(pages: BrowserContext | Page) -> None:
    """Let pages that are opened from now on draw as rarely as a very slow machine would.

    The 3D scene is drawn by the processor here, anew for every frame, which would leave little of it to the tests.
    """
    pages.add_init_script(_FEW_FRAMES)


@contextmanager
def open_page(browser: Browser, url: str, *, width: int, height: int) -> Iterator[Page]:
    """Open an address in a window of so many pixels, and close it at the end."""
    page = browser.new_page(viewport={"width": width, "height": height})
    draw_few_frames(page)
    page.set_default_timeout(PATIENCE_MS)
    try:
        page.goto(url)
        yield page
    finally:
        page.close()


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
