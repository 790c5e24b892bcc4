"""Take the README's picture of the page: the robot on its way to a picture of the gallery.

    python -m tests.browser.page_screenshot

Needs Chromium.
"""

import math
import sys
import tempfile
from pathlib import Path

import numpy as np
from playwright.sync_api import Page, ViewportSize, sync_playwright

from ltvn_core.config import ROBUST
from ltvn_core.graph.planner import Planner
from ltvn_core.types import Pose
from ltvn_viz.app import AppOptions, RunningApp
from ltvn_viz.session.modes import Mode
from tests.browser.actions import click_goal_image
from tests.browser.chromium import chromium_path
from tests.browser.conftest import FLAGS
from tests.browser.running_app import running_app
from tests.browser.screenshots import save
from tests.repository import ROOT
from tests.waiting import PATIENCE_MS, until

OUTPUT = ROOT / "docs" / "images" / "page.webp"
WINDOW: ViewportSize = {"width": 1400, "height": 900}
MOST_BYTES = 300_000
UNDERWAY_M = 2.0
"""So far the robot has come when the picture is taken."""


def main() -> int:
    """Take the picture."""
    with (
        tempfile.TemporaryDirectory() as folder,
        sync_playwright() as playwright,
        running_app(AppOptions(port=0, recordings=Path(folder), seed=1)) as app,
    ):
        browser = playwright.chromium.launch(executable_path=chromium_path(), args=FLAGS)
        page = browser.new_page(viewport=WINDOW)
        page.set_default_timeout(PATIENCE_MS)
        page.goto(app.server.url)
        page.get_by_text("Next:").wait_for()
        page.add_style_tag(content=".mantine-Notification-root {display: none !important}")
        page.get_by_role("tab", name="Go").click()
        _set_out(app, page)
        save(page, OUTPUT, MOST_BYTES)
        browser.close()
    return 0


def _set_out(app: RunningApp, page: Page) -> None:
    """Click the picture with the longest way, and wait until the robot is well on it."""
    robot, live_map = app.session.state.live.robot, app.session.state.live_map
    start = robot.drawn_pose.copy()
    here = min(live_map.graph.nodes, key=lambda node: _gap_m(live_map.keyframes.observation(node).exact_pose, start))
    planner = Planner(live_map.graph, ROBUST.planning)
    click_goal_image(app, page, lambda offered: max(offered, key=lambda goal: planner.plan(here, goal).cost))
    until(lambda: app.session.mode is Mode.NAVIGATING)
    until(lambda: _gap_m(robot.drawn_pose, start) > UNDERWAY_M)


def _gap_m(a: Pose | None, b: Pose) -> float:
    return math.inf if a is None else float(np.hypot(*(a - b)[:2]))


if __name__ == "__main__":
    sys.exit(main())
