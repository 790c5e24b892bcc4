"""Take the pictures of `docs/page.md`: every tab at work, the page on a telephone and on a large screen.

    python -m tests.browser.tab_screenshots

Needs Chromium. Owns what the robot and the page do meanwhile.
"""

import math
import re
import shutil
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image
from playwright.sync_api import Browser, Page, ViewportSize, sync_playwright

from ltvn_core.config import ROBUST
from ltvn_core.graph.planner import Planner
from ltvn_core.types import Pose
from ltvn_viz.app import AppOptions, RunningApp
from ltvn_viz.session.inspection import QuestionName
from ltvn_viz.wishes.commands import OpenRecording
from ltvn_viz.wishes.modes import Mode
from tests.browser.actions import click_goal_image, hold_key, wait_for_rest
from tests.browser.chromium import chromium_path
from tests.browser.conftest import FLAGS
from tests.browser.debugger_page import DebuggerPage
from tests.browser.pages import draw_seldom, open_page, wait_until_drawn
from tests.browser.running_app import running_app
from tests.browser.screenshots import save, save_image, shown
from tests.repository import RECORDINGS, ROOT
from tests.waiting import PATIENCE_MS, until

FOLDER = ROOT / "docs" / "images" / "page"
WINDOW: ViewportSize = {"width": 1400, "height": 900}
SMALL: ViewportSize = {"width": 1000, "height": 700}
LARGE: ViewportSize = {"width": 1920, "height": 1080}
TELEPHONE: ViewportSize = {"width": 390, "height": 844}
DRIVEN_M, UNDERWAY_M = 0.8, 2.0
"""So far the robot has come when the pictures of driving by hand and of a query are taken."""
FAULT_S, FAULTY_EDGE = 20.1, re.compile("^edge ")
"""The moment of the recording on show, and the edge that the answer names there."""
_GAP_PX = 20
_NO_NOTICES = ".mantine-Notification-root {display: none !important}"


def main() -> int:
    """Take all pictures."""
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        for recording in RECORDINGS.glob("demo-*.rrd"):
            shutil.copy(recording, folder)
        options = AppOptions(port=0, recordings=Path(folder), seed=1)
        browser = playwright.chromium.launch(executable_path=chromium_path(), args=FLAGS)
        with running_app(options) as app:
            telephone = _on_telephone(app, browser, (None, "Go"))
            with open_page(browser, app.server.url, **WINDOW) as page:
                page.get_by_text("Next:").wait_for()
                page.add_style_tag(content=_NO_NOTICES)
                _drive(app, page)
                _go(app, page)
                _change_the_world(app, page)
                _replay(app, page)
                _ask_why(app, page, Path(folder))
                page.set_viewport_size(LARGE)
                _take(app, page, "large")
            telephone += _on_telephone(app, browser, ("Why",))
            save_image(_side_by_side(telephone), FOLDER / "telephone.webp")
        browser.close()
    return 0


def _drive(app: RunningApp, page: Page) -> None:
    """Drive by hand while it is recorded."""
    robot = app.session.state.live.robot
    start = robot.drawn_pose.copy()
    page.get_by_role("tab", name="Drive").click()
    page.get_by_role("button", name=re.compile("^Record")).click()
    page.locator("#ltvn-rec .lt-rec").wait_for()
    hold_key(app, page, "w", lambda: _gap_m(robot.drawn_pose, start) > DRIVEN_M)
    wait_for_rest(app)
    _take(app, page, "drive")
    page.get_by_role("button", name=re.compile("^Keep")).click()
    page.get_by_text("Kept as").first.wait_for(state="attached")


def _go(app: RunningApp, page: Page) -> None:
    """Click the image with the longest way, and wait until the robot is well on it."""
    page.get_by_role("tab", name="Go").click()
    robot, live_map = app.session.state.live.robot, app.session.state.live_map
    start = robot.drawn_pose.copy()
    here = min(live_map.graph.nodes, key=lambda node: _gap_m(live_map.keyframes.observation(node).exact_pose, start))
    planner = Planner(live_map.graph, ROBUST.planning)
    click_goal_image(app, page, lambda offered: max(offered, key=lambda goal: planner.plan(here, goal).cost))
    until(lambda: app.session.state.activity.mode is Mode.NAVIGATING)
    until(lambda: _gap_m(robot.drawn_pose, start) > UNDERWAY_M)
    _take(app, page, "go")
    page.keyboard.press("Escape")
    wait_for_rest(app)


def _change_the_world(app: RunningApp, page: Page) -> None:
    """Close a door and put down a box."""
    page.get_by_role("tab", name="World").click()
    page.get_by_role("button", name="Put a box in front of the robot").click()
    page.get_by_role("button", name="Take away box 1").wait_for()
    page.get_by_role("button", name=re.compile("^hall 2 – study")).click()
    page.get_by_role("button", name=re.compile("^hall 2 – study: closed")).wait_for()
    _take(app, page, "world")


def _replay(app: RunningApp, page: Page) -> None:
    """Open a recording in which queries fail."""
    app.session.send(OpenRecording("demo-fault.rrd", FAULT_S))
    until(lambda: app.session.state.activity.mode is Mode.REPLAY)
    page.get_by_role("tab", name="Replay").click()
    page.get_by_role("button", name="Back to the robot").wait_for()
    _take(app, page, "replay")


def _ask_why(app: RunningApp, page: Page, folder: Path) -> None:
    """Ask about the edge between two places that look alike."""
    page.get_by_role("tab", name="Why").click()
    debugger = DebuggerPage(app, page, folder)
    debugger.go_to_failure(2)
    debugger.follow(FAULTY_EDGE)
    debugger.ask(QuestionName.EDGE)
    _take(app, page, "why")


def _take(app: RunningApp, page: Page, name: str) -> None:
    """Take a picture as soon as the browser has drawn the map anew."""
    wait_until_drawn(page)
    page.mouse.move(5, 5)
    save(page, FOLDER / f"{name}.webp")


def _on_telephone(app: RunningApp, browser: Browser, tabs: Sequence[str | None]) -> list[Image.Image]:
    """Return what a telephone shows, with the sheet of each tab over the scene, or none."""
    telephone = browser.new_context(viewport=TELEPHONE, has_touch=True, is_mobile=True, color_scheme="dark")
    telephone.set_default_timeout(PATIENCE_MS)
    draw_seldom(telephone)
    page, seen = telephone.new_page(), []
    page.goto(app.server.url)
    page.locator("#ltvn-nav").get_by_role("button").first.wait_for()
    page.add_style_tag(content=_NO_NOTICES)
    for tab in tabs:
        if tab is not None:
            page.locator("#ltvn-nav").get_by_role("button", name=tab).click()
            page.get_by_role("button", name="close the panel").wait_for()
        wait_until_drawn(page)
        seen.append(shown(page))
    telephone.close()
    until(lambda: not app.server.viser.get_clients())
    return seen


def _side_by_side(pictures: list[Image.Image]) -> Image.Image:
    """Return pictures of one height in a row on white."""
    width = sum(each.width for each in pictures) + _GAP_PX * (len(pictures) - 1)
    sheet, left = Image.new("RGB", (width, pictures[0].height), "white"), 0
    for each in pictures:
        sheet.paste(each, (left, 0))
        left += each.width + _GAP_PX
    return sheet


def _gap_m(a: Pose | None, b: Pose) -> float:
    return math.inf if a is None else float(np.hypot(*(a - b)[:2]))


if __name__ == "__main__":
    sys.exit(main())
