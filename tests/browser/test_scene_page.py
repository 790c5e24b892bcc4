"""The map as one file, in a real browser that has no network: it is drawn, it turns, and it asks for nothing."""

import io
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageChops
from playwright.sync_api import Browser, Page, Request

from ltvn_core.data.recording.reader import Recording
from ltvn_core.evaluation.reports.map_svg import map_layout
from ltvn_viz.layers.scene_html import scene_html
from tests.browser.pages import draw_seldom
from tests.repository import DEMO_MAP
from tests.waiting import PATIENCE_MS, until

pytestmark = pytest.mark.browser

MOST_BYTES = 4_000_000


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The demo's map, as somebody gets it by mail."""
    path, recording = tmp_path_factory.mktemp("mail") / "map.html", Recording.open(DEMO_MAP)
    path.write_text(scene_html(recording, map_layout(recording)), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def sent() -> list[Request]:
    """What the page asked for."""
    return []


@pytest.fixture(scope="module")
def page(chromium: Browser, file: Path, sent: list[Request]) -> Iterator[Page]:
    context = chromium.new_context(offline=True, viewport={"width": 500, "height": 360}, has_touch=True)
    draw_seldom(context)
    page = context.new_page()
    page.set_default_timeout(PATIENCE_MS)
    page.on("request", lambda request: sent.append(request))
    page.goto(file.as_uri())
    yield page
    context.close()


def canvas(page: Page) -> Image.Image:
    """Return what the scene's canvas shows."""
    return Image.open(io.BytesIO(page.locator("canvas[data-engine]").screenshot(timeout=PATIENCE_MS))).convert("RGB")


def drawn(page: Page, holds: Callable[[Image.Image], bool]) -> Image.Image:
    """Wait until the canvas shows something."""

    def matching() -> Image.Image | None:
        now = canvas(page)
        return now if holds(now) else None

    found = until(matching, meanwhile=lambda: page.wait_for_timeout(500))
    assert found is not None
    return found


def is_full(shown: Image.Image) -> bool:
    return len(shown.getcolors(2**24) or ()) > 500


def blue(shown: Image.Image) -> int:
    """Count the pixels in the colour of edges that can be driven; nothing else in this flat has it."""
    red, green, blue = np.moveaxis(np.asarray(shown, int), 2, 0)
    return int(((blue > 180) & (blue > red + 90) & (green < 200)).sum())


def test_walls_and_graph_are_drawn_without_any_request(page: Page, sent: list[Request], file: Path) -> None:
    drawn(page, lambda shown: is_full(shown) and blue(shown) > 80)
    assert "327 nodes, 1,306 edges" in page.locator("body").inner_text()
    notice = page.locator("#webgl-software-rendering")
    assert (notice.count(), notice.is_visible()) == (1, False)
    outside = [request.url for request in sent if not request.url.startswith((file.as_uri(), "blob:", "data:"))]
    assert outside == []
    assert file.stat().st_size < MOST_BYTES


def test_the_scene_turns_with_a_drag_and_grows_with_the_wheel(page: Page) -> None:
    before = drawn(page, is_full)
    page.mouse.move(300, 200)
    page.mouse.down()
    page.mouse.move(420, 230, steps=4)
    page.mouse.up()
    turned = drawn(page, lambda shown: is_full(shown) and differs(shown, before))
    page.mouse.wheel(0, -600)
    drawn(page, lambda shown: is_full(shown) and differs(shown, turned))


def test_the_scene_turns_under_a_finger(page: Page) -> None:
    before = drawn(page, is_full)
    touch = page.context.new_cdp_session(page)
    for kind, x in (("touchStart", 250), ("touchMove", 290), ("touchMove", 360), ("touchMove", 400)):
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [{"x": x, "y": 200}]})
    touch.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    drawn(page, lambda shown: is_full(shown) and differs(shown, before))


def differs(one: Image.Image, other: Image.Image) -> bool:
    """Tell whether a good part of a picture is another."""
    return one.size == other.size and bool(
        (np.asarray(ImageChops.difference(one, other)).max(axis=2) > 30).mean() > 0.1
    )
