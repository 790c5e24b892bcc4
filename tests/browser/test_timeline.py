"""The timeline at the foot of the page: looking back at a run that goes on, by click, by key and by button."""

import re
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Page, expect

from ltvn_core.navigation import events as e
from ltvn_core.worlds import LightChanged
from tests.browser.flat_app import FlatApp, serving, until_shown
from tests.browser.pages import open_page

pytestmark = pytest.mark.browser

STRIP = ".ltvn-time-strip"


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> Iterator[FlatApp]:
    with serving(tmp_path_factory.mktemp("recordings")) as app:
        app.harness.state.live.emit(e.QueryStarted(7, 12))
        app.harness.state.live.emit(e.QueryEnded(7, 12, e.Outcome.NO_PATH, 1, 0, 0.0))
        yield app


@pytest.fixture(scope="module")
def opened(app: FlatApp, chromium: Browser) -> Iterator[Page]:
    with open_page(chromium, app.server.url, width=1000, height=640, draws=False) as page:
        page.locator(STRIP).wait_for()
        until_shown(app, lambda now: now.timeline.length_s > 3.0)
        yield page


@pytest.fixture
def page(app: FlatApp, opened: Page) -> Page:
    """A page that shows the robot as it is now."""
    if not app.harness.now.timeline.is_now:
        opened.get_by_role("button", name="back to now").click()
    until_shown(app, lambda now: now.timeline.is_now)
    return opened


def click_strip(page: Page, share: float) -> None:
    """Click at a share of the strip's width."""
    strip = page.locator(STRIP)
    box = strip.bounding_box()
    assert box is not None
    # Through the locator, which waits until nothing covers the strip: at first the loading screen does.
    strip.click(position={"x": share * box["width"], "y": box["height"] / 2})


def test_a_click_into_the_strip_looks_back_and_live_returns(app: FlatApp, page: Page) -> None:
    expect(page.get_by_role("button", name="back to now")).to_be_disabled()
    expect(page.get_by_role("button", name="play", exact=True)).to_be_disabled()

    click_strip(page, 0.5)
    past = until_shown(app, lambda now: not now.timeline.is_now).timeline
    assert 0.2 < past.time_s / past.length_s < 0.8
    expect(page.locator(".ltvn-time-clock")).to_contain_text("ago")

    page.get_by_role("button", name="back to now").click()
    until_shown(app, lambda now: now.timeline.is_now)
    expect(page.locator(".ltvn-time-clock")).not_to_contain_text("ago")


def test_the_past_plays_as_fast_as_was_asked_until_it_is_now(app: FlatApp, page: Page) -> None:
    page.get_by_label("speed of playing").select_option("8×")
    until_shown(app, lambda now: now.timeline.speed == 8.0)
    click_strip(page, 0.3)
    until_shown(app, lambda now: not now.timeline.is_now)

    page.get_by_role("button", name="play", exact=True).click()

    until_shown(app, lambda now: now.timeline.is_now)


def test_keys_on_the_strip_and_off_it_go_through_time(app: FlatApp, page: Page) -> None:
    page.locator(STRIP).focus()
    page.keyboard.press("Home")
    until_shown(app, lambda now: not now.timeline.is_now and now.timeline.time_s < 0.1)
    page.keyboard.press("ArrowRight")
    until_shown(app, lambda now: 0.9 < now.timeline.time_s < 1.1)
    page.keyboard.press("End")
    until_shown(app, lambda now: now.timeline.is_now)
    page.keyboard.press("[")
    until_shown(app, lambda now: not now.timeline.is_now)


def test_queries_are_bars_that_say_how_they_ended_and_buttons_go_there(app: FlatApp, page: Page) -> None:
    page.get_by_role("button", name="previous query").click()
    past = until_shown(app, lambda now: not now.timeline.is_now).timeline
    box = page.locator(STRIP).bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + box["width"] * past.time_s / past.length_s + 1, box["y"] + 9)
    hint = page.locator(".ltvn-time-hint")
    expect(hint).to_contain_text("query 7 to node 12: failed")
    shown = hint.bounding_box()
    clock = page.locator(".ltvn-time-clock").bounding_box()
    assert shown is not None
    assert clock is not None
    assert shown["y"] + shown["height"] <= clock["y"], "the clock stays in sight"


def test_the_strip_shows_more_detail_and_the_whole_run_again(page: Page) -> None:
    slider = page.get_by_role("slider", name="moment on show")
    page.get_by_role("button", name="zoom in").click()
    page.get_by_role("button", name="show the whole run").click()
    expect(slider).to_have_attribute("aria-valuetext", re.compile("now"))


def test_each_lane_has_a_name_beside_the_strip_where_there_is_room(page: Page) -> None:
    names = page.locator(".ltvn-time-names > div")
    expect(names).to_have_text(["queries", "recording", "driving", "plan", "edges", "world"])
    box = page.locator(STRIP).bounding_box()
    assert box is not None
    for name in names.all():
        beside = name.bounding_box()
        assert beside is not None
        assert beside["x"] + beside["width"] <= box["x"]
        assert box["y"] <= beside["y"] < beside["y"] + beside["height"] <= box["y"] + box["height"]
        assert name.evaluate("shown => shown.scrollWidth <= shown.clientWidth")
    page.set_viewport_size({"width": 390, "height": 844})
    expect(names.first).to_be_hidden()
    box, dock = page.locator(STRIP).bounding_box(), page.locator("#timeline-dock").bounding_box()
    assert box is not None
    assert dock is not None
    assert box["width"] > 0.9 * dock["width"]
    page.set_viewport_size({"width": 1000, "height": 640})


def test_keys_read_what_a_pointer_there_is_told_and_many_events_of_a_kind_are_counted(app: FlatApp, page: Page) -> None:
    live = app.harness.state.live
    for _ in range(5):
        live.emit(e.WorldChanged(LightChanged(0.5)))
    hint = page.locator(".ltvn-time-hint")
    page.mouse.move(500, 5)
    page.get_by_role("slider", name="moment on show").blur()
    expect(hint).to_be_hidden()
    page.locator(STRIP).focus()
    page.keyboard.press("Semicolon")
    expect(hint).to_contain_text("world: ◈ world changed: 5×")
    slider = page.get_by_role("slider", name="moment on show")
    expect(slider).to_have_attribute("aria-valuetext", re.compile("world changed: 5×"))
    slider.blur()
    expect(hint).to_be_hidden()


def test_the_words_are_explained_in_a_window_that_escape_closes(page: Page) -> None:
    page.get_by_role("tab", name="Why").click()
    page.get_by_role("button", name="What do the words mean?").first.click()
    words = page.get_by_role("dialog", name="what the words mean")
    expect(words).to_contain_text("R_p: pruning threshold")
    page.keyboard.press("Escape")
    expect(words).to_have_count(0)
