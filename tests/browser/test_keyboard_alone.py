"""A person without a mouse: every tab, goal, recording and question by the keyboard alone."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from ltvn_viz.wishes import commands as c
from ltvn_viz.wishes.modes import Mode
from tests.browser.flat_app import FlatApp, serving, until_shown
from tests.browser.pages import open_page
from tests.waiting import until

WINDOW = {"width": 1000, "height": 640}
pytestmark = pytest.mark.browser

TABS = ("Drive", "Go", "World", "Replay", "Why")
MOST_TABS = 60
"""No control of the page is farther away than this by Tab."""
_RING_AROUND_FOCUS = """() => {
    const focused = document.activeElement;
    const style = getComputedStyle(focused);
    const reach = parseFloat(style.outlineWidth) + parseFloat(style.outlineOffset);
    const [box, row] = [focused, focused.closest("[role=tablist]")].map((part) => part.getBoundingClientRect());
    return { width: parseFloat(style.outlineWidth), left: box.left - row.left - reach, top: box.top - row.top - reach };
}"""


@pytest.fixture
def app(tmp_path: Path) -> Iterator[FlatApp]:
    with serving(tmp_path) as app:
        yield app


def tab_to(page: Page, wanted: Locator) -> None:
    """Press Tab until a control has the focus, once it can have it."""
    expect(wanted.first).to_be_enabled()
    for _ in range(MOST_TABS):
        if wanted.first.evaluate("control => control === document.activeElement"):
            return
        page.keyboard.press("Tab")
    pytest.fail(f"no Tab leads to {wanted}")


def choose_tab(page: Page, name: str) -> None:
    """Go to the row of tabs by Tab and through it by the arrows."""
    tab_to(page, page.locator("[role=tab][aria-selected=true]"))
    tab = page.get_by_role("tab", name=name)
    for _ in TABS:
        if tab.get_attribute("aria-selected") == "true":
            return
        page.keyboard.press("ArrowRight")
    expect(tab).to_have_attribute("aria-selected", "true")


def test_arrows_choose_tabs_where_tab_brought_the_focus_and_drive_again_after_escape(app: FlatApp, page: Page) -> None:
    before = app.harness.robot.pose.copy()
    for name in TABS:
        choose_tab(page, name)
        ring = page.evaluate(_RING_AROUND_FOCUS)
        assert ring["width"] > 0
        assert min(ring["left"], ring["top"]) >= 0
    expect(page.locator(".ltvn-status")).to_contain_text("Esc")
    assert (app.harness.robot.pose == before).all()

    page.keyboard.press("Escape")
    page.keyboard.down("ArrowRight")
    until(lambda: (app.harness.robot.pose != before).any())
    page.keyboard.up("ArrowRight")


def test_a_goal_a_recording_a_replay_and_a_question_by_the_keyboard_alone(app: FlatApp, page: Page) -> None:
    choose_tab(page, "Go")
    tab_to(page, page.locator("#root img[data-ltvn-action=select]"))
    page.keyboard.press("Enter")
    until_shown(app, lambda now: now.mode is Mode.NAVIGATING)
    until_shown(app, lambda now: now.mode is Mode.TELEOP)

    choose_tab(page, "Drive")
    tab_to(page, page.get_by_role("button", name=re.compile("^Record")))
    page.keyboard.press("Enter")
    until_shown(app, lambda now: now.recording.name is not None)
    tab_to(page, page.get_by_role("button", name=re.compile("^Keep")))
    page.keyboard.press("Enter")
    until_shown(app, lambda now: now.recording.name is None)

    choose_tab(page, "Replay")
    tab_to(page, page.get_by_role("tabpanel").get_by_role("combobox"))
    page.keyboard.press("ArrowDown")
    page.keyboard.press("Enter")
    tab_to(page, page.get_by_role("button", name=re.compile("^Open")))
    page.keyboard.press("Enter")
    until_shown(app, lambda now: now.mode is Mode.REPLAY)

    choose_tab(page, "Why")
    asked = app.harness.now.inspection.question
    tab_to(page, page.locator(".lt-question[aria-pressed=false]"))
    page.keyboard.press("Enter")
    until_shown(app, lambda now: now.inspection.question != asked)


def test_a_number_typed_into_the_palette_is_the_goal_and_an_unknown_one_moves_nothing(app: FlatApp, page: Page) -> None:
    nodes = [int(node) for node in app.harness.now.moment.graph.ids]
    goal = next(node for node in nodes if any(str(other).startswith(str(node)) and other != node for other in nodes))
    palette = page.get_by_role("dialog", name="commands")
    page.keyboard.press("Control+k")
    palette.get_by_role("textbox").fill("node 123456")
    page.keyboard.press("Enter")
    until_shown(app, lambda now: now.message is not None and "123456" in now.message.text)
    assert app.session.state.activity.mode is Mode.TELEOP
    expect(palette).to_have_count(0)

    page.keyboard.press("Control+k")
    palette.get_by_role("textbox").fill("go to node")
    page.keyboard.press("Enter")
    expect(palette.get_by_role("textbox")).to_have_value("node ")
    page.keyboard.type(str(goal))
    expect(palette.get_by_role("button", name=f"Go to node {goal}", exact=True)).to_be_visible()
    page.keyboard.press("Enter")
    until_shown(app, lambda now: now.destination == goal)


def test_the_robot_is_stopped_by_the_palette_of_a_page_that_only_watches(
    app: FlatApp, page: Page, chromium: Browser
) -> None:
    app.session.send(c.Ask(c.Action.GOAL, max(int(node) for node in app.harness.now.moment.graph.ids)))
    until_shown(app, lambda now: now.mode is Mode.NAVIGATING)
    with open_page(chromium, app.server.url, width=1000, height=640, draws=False) as other:
        other.get_by_text("Next:").wait_for()
        other.keyboard.press("Control+k")
        other.get_by_role("dialog", name="commands").get_by_role("textbox").fill("stop the robot")
        other.keyboard.press("Enter")
        until_shown(app, lambda now: now.mode is Mode.TELEOP)
