"""Real pages that freeze, reload and watch: what the robot does, and what the person who comes back reads."""

import contextlib
import re
import signal
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest
from playwright.sync_api import Browser, Page, expect

from ltvn_viz.session.inspection import QuestionName
from ltvn_viz.wishes.modes import Mode
from tests.browser.debugger_page import press_question
from tests.browser.drive_page import renderers
from tests.browser.flat_app import FlatApp, navigate_far, serving, until_shown
from tests.browser.pages import open_page
from tests.viz.page_sockets import open_live_page
from tests.waiting import until

pytestmark = pytest.mark.browser


@pytest.fixture
def app(tmp_path: Path) -> Iterator[FlatApp]:
    # How soon the robot stands is measured without a browser; one that is drawn by software may be starved for longer.
    with serving(tmp_path, lease_s=2.0, idle_s=3600.0) as app:
        yield app


def go_on(app: FlatApp, page: Page) -> None:
    page.get_by_role("button", name=re.compile("^Go on")).locator("visible=true").first.click()
    until_shown(app, lambda now: now.mode is Mode.NAVIGATING)


def test_a_query_pauses_while_the_only_page_is_frozen_or_reloads_and_goes_on_by_a_click(
    app: FlatApp, chromium: Browser
) -> None:
    with open_page(chromium, app.server.url, width=1000, height=640, draws=False) as page:
        page.get_by_text("Next:").wait_for()
        navigate_far(app)
        frozen = renderers()
        try:
            for process in frozen:
                process.send_signal(signal.SIGSTOP)
            until_shown(app, lambda now: now.mode is Mode.PAUSED)
        finally:
            for process in frozen:
                with contextlib.suppress(psutil.Error):
                    process.send_signal(signal.SIGCONT)
        expect(
            page.get_by_text(re.compile(r"Paused: the last page froze or lost its connection at \d\d:\d\d"))
        ).to_be_visible()
        go_on(app, page)
        page.reload()
        until_shown(app, lambda now: now.mode is Mode.PAUSED)
        expect(page.get_by_text(re.compile(r"Paused: the last page was closed at \d\d:\d\d"))).to_be_visible()
        go_on(app, page)
        page.keyboard.press("Escape")
        until_shown(app, lambda now: now.mode is Mode.TELEOP)


def test_a_watching_page_is_grey_and_says_why(app: FlatApp, chromium: Browser) -> None:
    with (
        open_live_page(app.server) as driver,
        open_page(chromium, app.server.url, width=1000, height=640, draws=False) as page,
    ):
        page.get_by_text("Next:").wait_for()
        driver.take_seat()
        expect(page.get_by_text("Another page drives")).to_be_visible()
        page.reload()
        expect(page.get_by_text("Another page drives")).to_be_visible()
        page.get_by_role("tab", name="Drive").click()
        record = page.get_by_role("button", name=re.compile("^Record"))
        until(lambda: float(record.evaluate("each => getComputedStyle(each).opacity")) < 0.5)
        record.hover()
        expect(record).to_have_attribute("title", "Page 1 drives. Take over to use this.")
        record.click()
        minutes = page.get_by_label("Minutes").locator("visible=true").first
        minutes.fill("9")
        expect(minutes).to_have_value("3")
        assert app.harness.now.recording.name is None
        page.get_by_role("tab", name="Why").click()
        press_question(page, QuestionName.TIME)
        expect(page.locator(".lt-question[aria-pressed=true]")).to_have_text("What went wrong?")
        assert not app.harness.state.debugger.is_on
        page.get_by_role("button", name="Take over", exact=True).first.click()
        expect(page.get_by_text("Another page drives")).to_be_hidden()
