"""Keys are named as the keyboard of whoever sits there has them, and as a US keyboard has them where nobody tells."""

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.browser.flat_app import FlatApp, serving
from tests.browser.pages import draw_nothing

pytestmark = pytest.mark.browser

_GERMAN = {"BracketLeft": "ü", "BracketRight": "+", "Semicolon": "ö", "Quote": "ä", "Minus": "ß", "Equal": "´"}
_FRENCH = {"KeyW": "z", "KeyA": "q", "KeyS": "s", "KeyD": "d"}


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> Iterator[FlatApp]:
    with serving(tmp_path_factory.mktemp("recordings")) as app:
        yield app


def opened(app: FlatApp, chromium: Browser, layout: dict[str, str] | None) -> Page:
    """Open the page on a computer whose keyboard has such a layout, or whose browser does not tell."""
    page = chromium.new_page(viewport={"width": 1400, "height": 900})
    draw_nothing(page)
    known = "undefined" if layout is None else f"{{ getLayoutMap: async () => new Map(Object.entries({layout})) }}"
    page.add_init_script(f"Object.defineProperty(navigator, 'keyboard', {{ value: {known} }})")
    page.goto(app.server.url)
    page.get_by_text("Next:").wait_for()
    return page


def caps_in_help(page: Page) -> list[str]:
    return page.locator(".ltvn-help dt").all_text_contents()


def test_help_and_buttons_have_the_caps_of_a_german_keyboard(app: FlatApp, chromium: Browser) -> None:
    page = opened(app, chromium, _GERMAN)
    expect(page.get_by_role("button", name="previous query")).to_have_attribute("title", "previous query (ß)")
    assert {"Ü", "+", "Ö", "Ä", "ß", "´"} <= set(caps_in_help(page))
    page.close()


def test_the_palette_has_the_caps_of_a_german_keyboard_also_while_one_types(app: FlatApp, chromium: Browser) -> None:
    page = opened(app, chromium, _GERMAN)
    page.keyboard.press("Control+k")
    palette = page.get_by_role("dialog")
    expect(palette.get_by_text("Key: R")).to_be_visible()
    palette.get_by_role("textbox").fill("query")
    expect(palette.get_by_text("Key: ß")).to_be_visible()
    palette.get_by_role("textbox").fill("event")
    expect(palette.get_by_text("Key: Ö")).to_be_visible()
    page.close()


def test_texts_name_the_driving_keys_of_a_french_keyboard(app: FlatApp, chromium: Browser) -> None:
    page = opened(app, chromium, _FRENCH)
    expect(page.locator(".ltvn-status")).to_contain_text("Z Q S D")
    page.get_by_role("tab", name="Drive").click()
    expect(page.get_by_role("tabpanel").locator(".ltvn-by-key").first).to_contain_text("Z Q S D")
    page.close()


def test_a_browser_that_does_not_tell_has_us_caps(app: FlatApp, chromium: Browser) -> None:
    page = opened(app, chromium, None)
    expect(page.locator(".ltvn-status")).to_contain_text("W A S D")
    assert {"[", "]", ";", "'", "-", "="} <= set(caps_in_help(page))
    page.close()
