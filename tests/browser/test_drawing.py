"""How detailed the page draws its scene: as quickly as this computer can, as one chose, and never flickering."""

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Page, expect

from ltvn_viz.panels.status_panel import PANEL_MARK
from ltvn_viz.server.guarded_server import GuardedServer
from ltvn_viz.server.index_page import STATIC
from tests.browser.pages import draw_nothing
from tests.waiting import PATIENCE_MS, until

pytestmark = pytest.mark.browser

SLOWLY = "Light drawing: this device draws slowly"
FRAMES_OF = """
let frameMs = %d;
requestAnimationFrame = (callback) => setTimeout(() => callback(performance.now()), frameMs);
cancelAnimationFrame = clearTimeout;
const read = WebGL2RenderingContext.prototype.getParameter;
WebGL2RenderingContext.prototype.getParameter = function (name) {
  return name === 37446 ? "A graphics card" : read.call(this, name);
};
"""
"""What draws is said to be a card, and frames come so many milliseconds apart."""
MOVE = "window.moving = setInterval(() => window.__viserMutable?.requestRender(), 50)"
IS_SMOOTHED = (
    "() => document.querySelector('canvas[data-engine]').getContext('webgl2').getContextAttributes().antialias"
)
CSS_WIDTH = "() => document.querySelector('canvas[data-engine]').clientWidth"
WIDTH = "() => document.querySelector('canvas[data-engine]').width"
IS_THERE = "() => Boolean(window.__viserMutable?.nodeRefFromName['/thing/outline']?.children[0])"
IS_RIMMED = "() => window.__viserMutable.nodeRefFromName['/thing/outline'].children[0].layers.mask === 1"


@pytest.fixture
def levels(chromium: Browser) -> Iterator[Page]:
    """An empty page that knows how levels are judged, and tells those after frames of some milliseconds each."""
    page = chromium.new_page()
    judge = (STATIC / "drawing_speed.js").read_text(encoding="utf-8")
    page.add_script_tag(
        content=f"""{judge}
        const speed = drawingSpeed(0);
        let now = 0;
        function after(count, frameMs) {{
          for (let frame = 0; frame < count; frame++) judgeFrame(speed, frameMs(frame), (now += frameMs(frame)));
          return speed.level;
        }}"""
    )
    yield page
    page.close()


def test_slow_frames_make_the_drawing_lighter_step_by_step_and_hiccups_do_not(levels: Page) -> None:
    assert levels.evaluate("after(600, (frame) => (frame % 4 === 0 ? 700 : 16))") == 0
    assert levels.evaluate("after(12, () => 90)") == 1
    assert levels.evaluate("after(600, () => 30)") == 1
    assert levels.evaluate("after(120, () => 90)") == 2


def test_what_was_too_slow_is_tried_again_later_and_later(levels: Page) -> None:
    """A computer that is quick when it draws lightly, and slow as soon as it draws fully."""
    changes = levels.evaluate("""() => {
      const at = [];
      let level = 0;
      while (now < 1200000) {
        const was = level;
        level = after(1, () => (level === 0 ? 90 : 10));
        if (level !== was) at.push(now);
      }
      return at;
    }""")
    lightly = [begin - end for end, begin in zip(changes[0::2], changes[1::2], strict=False)]
    assert 2 <= len(lightly) <= 12
    assert lightly == sorted(lightly)
    assert lightly[-1] > 10 * lightly[0]


def test_a_slow_page_says_that_it_draws_lightly_and_one_may_choose(chromium: Browser) -> None:
    with GuardedServer() as server:
        server.gui.add_html(PANEL_MARK)
        for name in ("/thing", "/thing/outline"):
            server.scene.add_box(name, dimensions=(1.0, 1.0, 1.0), cast_shadow=False)
        window = chromium.new_context(viewport={"width": 1100, "height": 500}, device_scale_factor=2)
        draw_nothing(window)
        window.add_init_script("localStorage.removeItem('ltvn-drawing')")
        window.add_init_script(FRAMES_OF % 90)
        page = window.new_page()
        page.set_default_timeout(PATIENCE_MS)
        page.goto(server.url)
        until(lambda: page.evaluate(IS_THERE))
        said = page.locator(".ltvn-drawn")
        expect(said).to_be_hidden()
        assert page.evaluate(IS_RIMMED)
        full = page.evaluate(WIDTH)
        page.evaluate(MOVE)
        expect(said).to_have_text(SLOWLY)
        until(lambda: not page.evaluate(IS_RIMMED))
        assert page.evaluate(WIDTH) < full
        assert page.evaluate(WIDTH) >= page.evaluate(CSS_WIDTH), "never less than one for each pixel of the page"
        page.evaluate("clearInterval(window.moving)")
        until(lambda: page.evaluate(IS_RIMMED) and page.evaluate(WIDTH) == full)
        expect(said).to_have_text(SLOWLY)
        page.keyboard.press("Shift")
        until(lambda: not page.evaluate(IS_RIMMED))
        page.evaluate(MOVE)
        page.get_by_label("drawing of the scene").select_option("Full")
        expect(said).to_be_hidden()
        until(lambda: page.evaluate(WIDTH) == full)
        assert page.evaluate(IS_RIMMED)
        page.get_by_label("drawing of the scene").select_option("Light")
        expect(said).to_have_text("Light drawing")
        assert page.evaluate(IS_SMOOTHED)
        window.close()


def test_a_page_that_the_processor_draws_is_light_from_the_beginning(chromium: Browser) -> None:
    with GuardedServer() as server:
        server.gui.add_html(PANEL_MARK)
        page = chromium.new_page(viewport={"width": 800, "height": 500})
        draw_nothing(page)
        page.add_init_script("localStorage.removeItem('ltvn-drawing')")
        page.set_default_timeout(PATIENCE_MS)
        page.goto(server.url)
        expect(page.locator(".ltvn-drawn")).to_have_text(SLOWLY)
        assert not page.evaluate(IS_SMOOTHED)
        page.close()
