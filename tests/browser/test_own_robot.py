"""A robot of one's own in the page: the example's, which no simulator knows, on the wall's clock."""

import math
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, Page, expect

from ltvn_core.navigation.events import Outcome
from ltvn_core.recording.reader import Recording
from ltvn_core.types import Pose
from ltvn_viz.app import AppOptions, RunningApp
from ltvn_viz.session.modes import Mode
from ltvn_viz.timeline.run_moment import moment_of
from tests.browser.pages import open_page
from tests.browser.running_app import running_app
from tests.repository import ROOT
from tests.waiting import PATIENCE_S, until

pytestmark = pytest.mark.browser

EXAMPLE = f"{ROOT / 'examples' / '05_drive_your_own_robot.py'}:make_robot"
TRIP_S = 2 * PATIENCE_S


@pytest.fixture
def app(tmp_path: Path) -> Iterator[RunningApp]:
    with running_app(AppOptions(port=0, recordings=tmp_path, robot=EXAMPLE, predictor="network")) as app:
        yield app


@pytest.fixture
def page(app: RunningApp, chromium: Browser) -> Iterator[Page]:
    with open_page(chromium, app.server.url, width=1000, height=640, draws=False) as page:
        page.get_by_text("Next:").wait_for()
        yield page


def pose(app: RunningApp) -> Pose:
    """Where the robot's own wheels say it is."""
    return app.session.state.live.robot.state().odometry


def hold(app: RunningApp, page: Page, key: str, holds: Callable[[], bool]) -> None:
    """Hold a key until something holds; press it anew where the page stalled for longer than the lease."""
    for _ in range(5):
        page.keyboard.down(key)
        until(lambda: app.server.seat.current_twist() is not None)
        until(lambda: holds() or app.server.seat.current_twist() is None)
        page.keyboard.up(key)
        if holds():
            return
    raise AssertionError(f"holding {key} never did it; the robot is at {pose(app)}")


def turn_by(app: RunningApp, page: Page, angle_rad: float) -> None:
    start = float(pose(app)[2])
    turned = [0.0, start]

    def enough() -> bool:
        now = float(pose(app)[2])
        turned[:] = turned[0] + abs(math.remainder(now - turned[1], math.tau)), now
        return turned[0] > angle_rad

    hold(app, page, "a", enough)


def drive_by(app: RunningApp, page: Page, length_m: float) -> None:
    start = pose(app)
    hold(app, page, "w", lambda: float(np.hypot(*(pose(app) - start)[:2])) > length_m)


def gallery_of_built_map(app: RunningApp, page: Page) -> list[int]:
    """Return the goals that the page shows, once it shows those of the map as it is now and no earlier ones."""
    shown: list[int] = []

    def is_shown() -> bool:
        ids = page.locator(".lt-gallery img").evaluate_all("images => images.map(image => +image.dataset.id)")
        shown[:] = ids
        offered = list(app.session.state.goals.gallery)
        return bool(ids) and ids == offered and app.session.state.live_map.graph.nodes.keys() >= set(offered)

    until(is_shown)
    return shown


def test_it_is_driven_recorded_mapped_and_sent_somewhere(app: RunningApp, page: Page, tmp_path: Path) -> None:
    live, live_map = app.session.state.live, app.session.state.live_map
    expect(page.get_by_text("What the method sees: 96 x 72 pixels")).to_be_visible()

    page.get_by_role("button", name=re.compile("^Record")).click()
    until(lambda: live.recorder.is_on)
    turn_by(app, page, 6.5)
    drive_by(app, page, 1.2)
    turn_by(app, page, 3.0)
    until(lambda: len(live_map.graph.nodes) > 5)
    page.get_by_role("button", name=re.compile("^Keep")).click()
    until(lambda: not live.recorder.is_on)

    page.get_by_role("button", name=re.compile("^Build")).click()
    expect(page.get_by_text("Building the map").first).to_be_visible()
    until(lambda: app.session.mode is Mode.TELEOP and app.session.state.worker.pending == 0)

    page.get_by_role("tab", name="Go").click()
    goals = gallery_of_built_map(app, page)
    away = [np.hypot(*(live_map.keyframes.observation(goal).odometry - pose(app))[:2]) for goal in goals]
    goal, start = goals[int(np.argmax(away))], pose(app)
    page.locator(f'.lt-gallery img[data-id="{goal}"]').click()
    until(lambda: app.session.mode is Mode.NAVIGATING)
    until(lambda: app.session.mode is Mode.TELEOP, patience_s=TRIP_S)
    ended = moment_of(live.timeline).progress.ended
    assert ended is not None
    assert (ended.goal, ended.outcome) == (goal, Outcome.ARRIVED)
    assert not np.array_equal(pose(app), start)
    expect(page.get_by_text("Last query: arrived")).to_be_visible()

    recording = Recording.open(next(tmp_path.glob("*.rrd")))
    assert recording.meta.scene == "room robot"
    assert (recording.meta.camera.width, recording.meta.camera.height) == (96, 72)
    seen = recording.observation(recording.frames[-1])
    assert seen.exact_pose is None
    assert seen.original is not None
    assert (seen.original.camera.width, seen.original.camera.height) == (160, 120)
