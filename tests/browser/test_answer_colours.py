"""Words in a colour of the scene, in an answer of the “Why” tab: whoever reads the page can read them."""

import re
from collections.abc import Iterator
from typing import Literal

import pytest
from playwright.sync_api import Browser, Locator, Page

from ltvn_core import palette
from ltvn_core.analysis.answer import Answer, Coloured, Paragraph
from ltvn_core.palette import Rgb8
from ltvn_viz.debugger.answer_html import answer_html
from ltvn_viz.panels.html_widgets import STYLE
from ltvn_viz.server.index_page import STATIC

pytestmark = pytest.mark.browser

COLOURS = {name: colour for name, colour in vars(palette).items() if isinstance(colour, Rgb8) and name != "BACKGROUND"}
READABLE = 4.5
"""The least contrast of words, by the Web Content Accessibility Guidelines."""
_DRAWN = """(shown, property) => {
    const brush = document.createElement("canvas").getContext("2d");
    brush.fillStyle = getComputedStyle(shown)[property];
    brush.fillRect(0, 0, 1, 1);
    return [...brush.getImageData(0, 0, 1, 1).data].slice(0, 3);
}"""


@pytest.fixture(scope="module")
def page(chromium: Browser) -> Iterator[Page]:
    """A page with an answer that has a word in each colour."""
    words = tuple(Coloured(name, colour) for name, colour in COLOURS.items())
    theme = (STATIC / "theme.css").read_text(encoding="utf-8")
    answer = answer_html(Answer((Paragraph(words),)))
    page = chromium.new_page()
    page.set_content(f"<style>{theme} body {{ background: var(--ltvn-plate); }}</style>{STYLE}{answer}")
    yield page
    page.close()


def light(shown: Locator, css: str) -> float:
    """Return how much light a colour of an element gives, 0 for black to 1 for white, as the eye weighs it."""
    parts = [part / 255 for part in shown.evaluate(_DRAWN, css)]
    red, green, blue = (part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


@pytest.mark.parametrize("scheme", ["dark", "light"])
def test_every_colour_can_be_read_on_dark_and_on_light(page: Page, scheme: Literal["dark", "light"]) -> None:
    page.emulate_media(color_scheme=scheme)
    ground = light(page.locator("body"), "backgroundColor")
    assert (ground > 0.5) == (scheme == "light")
    for name in COLOURS:
        word = light(page.get_by_text(re.compile(f"^{name}$")), "color")
        contrast = (max(word, ground) + 0.05) / (min(word, ground) + 0.05)
        assert contrast >= READABLE, (name, contrast)
