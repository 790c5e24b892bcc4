"""A robot of one's own in the page: the example's, which no simulator knows, on the wall's clock."""

import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from ltvn_core.data.recording.reader import Recording
from ltvn_core.navigation.events import Outcome
from ltvn_core.types import NodeId, Pose
from ltvn_viz.app import AppOptions, RunningApp
from ltvn_viz.timeline.run_moment import moment_of
from ltvn_viz.wishes.modes import Mode
from tests.browser.actions import click_goal_image, hold_key, press, wait_for_built_map
from tests.browser.running_app import running_app
from tests.repository import ROOT
from tests.waiting import PATIENCE_S, until

WINDOW = {"width": 1000, "height": 640}
pytestmark = pytest.mark.browser

EXAMPLE = f"{ROOT / 'examples' / '05_drive_your_own_robot.py'}:make_robot"
TRIP_S = 2 * PATIENCE_S


@pytest.fixture
def app(tmp_path: Path) -> Iterator[RunningApp]:
    with running_app(AppOptions(port=0, recordings=tmp_path, robot=EXAMPLE, predictor="network")) as app:
        yield app


def pose(app: RunningApp) -> Pose:
    """Where the robot's own wheels say it is."""
    return app.session.state.live.robot.state().odometry


def turn_by(app: RunningApp, page: Page, angle_rad: float) -> None:
    start = float(pose(app)[2])
    turned = [0.0, start]

    def enough() -> bool:
        now = float(pose(app)[2])
        turned[:] = turned[0] + abs(math.remainder(now - turned[1], math.tau)), now
        return turned[0] > angle_rad

    hold_key(app, page, "a", enough)


def drive_by(app: RunningApp, page: Page, length_m: float) -> None:
    start = pose(app)
    hold_key(app, page, "w", lambda: float(np.hypot(*(pose(app) - start)[:2])) > length_m)


def farthest(app: RunningApp, goals: Sequence[NodeId]) -> NodeId:
    """Return the goal whose image was taken farthest from where the robot is, so that it has a way to go."""
    keyframes, here = app.session.state.live_map.keyframes, pose(app)
    return max(goals, key=lambda goal: float(np.hypot(*(keyframes.observation(goal).odometry - here)[:2])))


def test_it_is_driven_recorded_mapped_and_sent_somewhere(app: RunningApp, page: Page, tmp_path: Path) -> None:
    live, live_map = app.session.state.live, app.session.state.live_map
    expect(page.locator("#ltvn-caption")).to_contain_text("What the method sees: 96 x 72 pixels")

    press(page, "Record", lambda: live.recorder.is_on)
    turn_by(app, page, 6.5)
    drive_by(app, page, 1.2)
    turn_by(app, page, 3.0)
    until(lambda: len(live_map.graph.nodes) > 5)
    press(page, "Keep", lambda: not live.recorder.is_on)

    page.get_by_role("button", name=re.compile("^Rebuild")).click()
    wait_for_built_map(app)

    page.get_by_role("tab", name="Go").click()
    start = pose(app)
    goal = click_goal_image(app, page, lambda offered: farthest(app, offered))
    until(lambda: app.session.state.activity.mode is Mode.NAVIGATING)
    until(lambda: app.session.state.activity.mode is Mode.TELEOP, patience_s=TRIP_S)
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
