"""One headless Chromium for all browser tests, with WebGL in software."""

from collections.abc import Iterator
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, expect, sync_playwright

from tests.browser.chromium import chromium_path
from tests.browser.pages import open_page
from tests.waiting import PATIENCE_MS

FLAGS = [
    "--headless=new",
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-gpu-compositing",
    "--disable-gpu-rasterization",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
]


@pytest.fixture(scope="session")
def chromium() -> Iterator[Browser]:
    """A browser; fails, and says what to do, where there is none."""
    path = chromium_path()
    if path is None:
        pytest.fail("Browser tests need Chromium or Chrome: run `make chromium`, or install it by hand.")
    expect.set_options(timeout=PATIENCE_MS)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=FLAGS)
        yield browser
        browser.close()


@pytest.fixture
def page(request: pytest.FixtureRequest, app: Any, chromium: Browser) -> Iterator[Page]:
    """A page of the module's app, in a window of the module's size."""
    window = getattr(request.module, "WINDOW", {"width": 1280, "height": 800})
    with open_page(chromium, app.server.url, **window, draws=False) as page:
        page.get_by_text("Next:").wait_for()
        yield page
