"""A link that was sent by somebody, in a real browser: the page shows what they saw, or says what is missing."""

import re
import shutil
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Page, expect

from ltvn_viz.debugger.share_question import ShareAction
from ltvn_viz.session.activities.playback import open_replay
from ltvn_viz.session.inspection import QuestionName, Selection
from ltvn_viz.session.share_links import link
from ltvn_viz.session.snapshot import Snapshot
from ltvn_viz.wishes.commands import Action, Ask
from ltvn_viz.wishes.modes import Mode
from tests.browser.actions import wait_for_rest
from tests.browser.debugger_page import press_question
from tests.browser.flat_app import FlatApp, serving, until_shown
from tests.browser.pages import open_page
from tests.repository import RECORDINGS

pytestmark = pytest.mark.browser

DRIVE = "demo-drive.rrd"
EDGE = (728, 724)


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> Iterator[FlatApp]:
    """The page, with the demo's drive in its folder."""
    folder = tmp_path_factory.mktemp("recordings")
    shutil.copy(RECORDINGS / DRIVE, folder / DRIVE)
    with serving(folder) as app:
        app.harness.state.open_replay = lambda name: open_replay(app.harness.library, name)
        yield app


@pytest.fixture
def page(app: FlatApp, chromium: Browser) -> Iterator[Page]:
    with open_page(chromium, "about:blank", width=1000, height=640, draws=False) as page:
        yield page
    # The next link asks for the same: only what is not on show any more can be seen to come.
    if app.session.state.activity.mode is Mode.REPLAY:
        app.session.send(Ask(Action.CLOSE))
    wait_for_rest(app)
    until_shown(app, lambda now: now.replay is None)


def open_link(app: FlatApp, page: Page, address: str) -> None:
    """Open a link, with the key that the terminal printed."""
    page.goto(app.server.link(address.removeprefix("/?")))
    page.get_by_text("Next:").wait_for()


def open_link_to_edge(app: FlatApp, page: Page) -> Snapshot:
    """Open a link to an edge at a moment of the demo's drive, and return what the page is told to show."""
    open_link(app, page, link(DRIVE, 42.5, QuestionName.EDGE, Selection(None, EDGE)))
    return until_shown(
        app,
        lambda now: (
            now.timeline.is_replay and abs(now.timeline.time_s - 42.5) < 1e-3 and now.inspection.selection.edge == EDGE
        ),
    )


def test_a_link_shows_the_recording_the_moment_and_the_edge(app: FlatApp, page: Page) -> None:
    now = open_link_to_edge(app, page)

    assert (now.replay, round(now.timeline.time_s, 3)) == (DRIVE, 42.5)
    assert now.inspection.selection.edge == EDGE
    expect(page.get_by_role("tab", name="Why")).to_have_attribute("aria-selected", "true")
    page.get_by_text(f"{EDGE[0]} → {EDGE[1]}").first.wait_for()
    assert until_shown(app, lambda now: bool(now.inspection.html)).inspection.question is QuestionName.EDGE
    assert "replay" not in page.url
    assert "token" not in page.url


def test_a_moment_is_saved_by_a_click_and_its_link_can_be_copied(app: FlatApp, page: Page) -> None:
    open_link_to_edge(app, page)
    page.get_by_role("tab", name="Why").click()
    expect(page.locator(".lt-question[aria-pressed=true]")).to_have_text("Why this edge?")
    press_question(page, QuestionName.SHARE)
    address = "/?replay=demo-drive.rrd&at=42.5&edge=728-724&tool=edge"
    expect(page.get_by_role("link", name="Link to this moment")).to_have_attribute("href", address)
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])

    page.get_by_role("button", name="copy it").click()

    expect(page.get_by_role("button", name="copied")).to_be_visible()
    assert page.evaluate("navigator.clipboard.readText()") == app.server.url.split("/#")[0] + address

    page.get_by_text(ShareAction.SAVE_EXCERPT).click()
    with page.expect_download() as downloading:
        page.get_by_role("button", name="moment-demo-drive").click()

    (saved,) = app.harness.library.folder.glob("moment-*.rrd")
    assert downloading.value.suggested_filename == saved.name
    assert downloading.value.path().read_bytes() == saved.read_bytes()


def test_where_no_script_may_copy_the_text_stands_there_selected(app: FlatApp, page: Page) -> None:
    open_link_to_edge(app, page)
    page.get_by_role("tab", name="Why").click()
    press_question(page, QuestionName.SHARE)
    command = page.locator(".lt-why code")
    command.evaluate("code => code.prepend('a_name_without_a_gap'.repeat(6))")
    assert command.evaluate("code => code.offsetWidth <= code.closest('[role=tabpanel]').clientWidth")
    page.evaluate("() => { navigator.clipboard.writeText = () => Promise.reject(new Error('no')); }")

    page.get_by_role("button", name="copy the command").click()

    expect(page.get_by_label("Copy this")).to_have_value(re.compile("^ltvn replay demo-drive.rrd --at 42.5$"))
    assert page.evaluate("document.activeElement.selectionEnd") == len("ltvn replay demo-drive.rrd --at 42.5")


def test_a_link_to_a_recording_that_is_not_there_is_said_and_the_page_goes_on(app: FlatApp, page: Page) -> None:
    open_link(app, page, "/?replay=<b>gone.rrd&at=3")
    page.get_by_text("There is no recording").first.wait_for()
    assert until_shown(app, lambda now: now.message is not None).message is not None
