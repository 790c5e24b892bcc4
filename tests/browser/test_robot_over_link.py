"""The page drives a robot of ROS 2: router, simulated robot and guard are processes of their own."""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, Page, expect

from ltvn_core.data.recording.demo_files import DEMO_MAP, demo_file
from ltvn_core.data.recording.map_file import load_map
from ltvn_core.data.recording.reader import Recording
from ltvn_core.geometry import relative
from ltvn_core.navigation.events import Outcome, QueryEnded
from ltvn_core.types import NodeId, Pose
from ltvn_viz.app import AppOptions, RunningApp
from ltvn_viz.session.goals import farthest_points
from ltvn_viz.timeline.run_moment import moment_of
from ltvn_viz.verbs.robot_processes import RobotProcesses, robot_processes, start_router
from ltvn_viz.wishes.modes import Mode
from tests.browser.actions import click_goal_image, hold_key
from tests.browser.pages import open_page
from tests.browser.running_app import running_app
from tests.waiting import PATIENCE_S, until

pytestmark = pytest.mark.browser

TRIP_S = 2 * PATIENCE_S
ATTEMPTS = 3


@pytest.fixture(scope="module")
def robot() -> Iterator[RobotProcesses]:
    """A robot that stands about a metre before a place that the page's gallery shows first."""
    known = load_map(demo_file(DEMO_MAP) or Path())
    exact = {node: known.observations[node].exact_pose for node in known.graph.nodes}
    poses = {node: pose for node, pose in exact.items() if pose is not None}
    goal = list(poses)[farthest_points(np.array(list(poses.values())), 1)[0]]
    x, y, yaw = min(poses.values(), key=lambda pose: _unlike_a_metre_before(pose, poses[goal]))
    with robot_processes("demo", "--start", str(x), str(y), str(np.degrees(yaw))) as processes:
        yield processes


def _unlike_a_metre_before(pose: Pose, goal: Pose) -> float:
    ahead, aside, turn = relative(pose, goal)
    return abs(ahead - 1.0) + abs(aside) + abs(turn)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("recordings")


@pytest.fixture(scope="module")
def app(robot: RobotProcesses, folder: Path) -> Iterator[RunningApp]:
    with running_app(AppOptions(port=0, recordings=folder, robot=robot.place, map=demo_file(DEMO_MAP))) as app:
        yield app


@pytest.fixture(scope="module")
def page(app: RunningApp, chromium: Browser) -> Iterator[Page]:
    with open_page(chromium, app.server.url, width=1000, height=640, draws=False) as page:
        page.get_by_text("Next:").wait_for()
        yield page


def pose(app: RunningApp) -> Pose:
    """Where the robot's own wheels say it is."""
    return app.session.state.live.robot.state().odometry


def picture(page: Page) -> str:
    return page.locator("#ltvn-colour").evaluate("picture => picture.toDataURL()")


def nearest(app: RunningApp, goals: Sequence[NodeId]) -> NodeId:
    """Return the goal that is nearest, but so far that the robot has a way to go."""
    keyframes, here = app.session.state.live_map.keyframes, pose(app)
    away = {goal: float(np.hypot(*(keyframes.observation(goal).odometry - here)[:2])) for goal in goals}
    return min(goals, key=lambda goal: abs(away[goal] - 1.0))


def go_to_a_place(app: RunningApp, page: Page) -> tuple[NodeId, QueryEnded]:
    """Go to a goal; choose it again where a stalled machine lost the images, which leaves a query without an end."""
    for _ in range(ATTEMPTS):
        goal = click_goal_image(app, page, lambda offered: nearest(app, offered))
        until(lambda: app.session.state.activity.mode is Mode.NAVIGATING)
        until(lambda: app.session.state.activity.mode is Mode.TELEOP, patience_s=TRIP_S)
        ended = moment_of(app.session.state.live.timeline).progress.ended
        if ended is not None and ended.outcome is not Outcome.CANCELLED:
            return goal, ended
    raise AssertionError("each query lost the robot")


def test_it_is_driven_seen_and_sent_to_a_place_of_the_map(app: RunningApp, page: Page) -> None:
    before, heading = picture(page), float(pose(app)[2])
    hold_key(app, page, "a", lambda: abs(float(pose(app)[2]) - heading) > 0.3)
    until(lambda: picture(page) != before)

    start = pose(app)
    page.get_by_role("tab", name="Go").click()
    goal, ended = go_to_a_place(app, page)
    assert (ended.goal, ended.outcome) == (goal, Outcome.ARRIVED)
    assert not np.array_equal(pose(app), start)
    expect(page.get_by_text("Last query: arrived")).to_be_attached()


def test_a_link_that_breaks_stops_it_and_comes_back_and_driving_does_not(
    app: RunningApp, page: Page, robot: RobotProcesses, folder: Path
) -> None:
    status, live = page.locator(".lt-line"), app.session.state.live
    expect(status).to_contain_text(re.compile("link (good|weak) · picture .* s · odometry .* s"))
    page.get_by_role("tab", name="Drive").click()
    page.get_by_role("button", name=re.compile("^Record")).click()
    until(lambda: live.recorder.is_on)
    heading = float(pose(app)[2])
    hold_key(app, page, "a", lambda: abs(float(pose(app)[2]) - heading) > 0.3)
    frames = live.recorder.status.frames
    page.keyboard.down("a")
    until(lambda: app.server.seat.current_twist() is not None)

    robot.router.kill()
    expect(page.get_by_role("alert").filter(has_text="does not answer: the link broke. It is stopped")).to_be_visible()
    expect(status).to_contain_text("link lost")
    last_heard_s = live.robot.state().stamp
    router = start_router(robot.address)
    try:
        expect(page.get_by_role("alert").filter(has_text=re.compile("Release the|answers again"))).to_be_visible()
        until(lambda: live.robot.state().stamp > last_heard_s)  # Images may come back before odometry does.
        stood = pose(app)
        page.keyboard.up("a")
        expect(page.get_by_role("alert").filter(has_text="answers again")).to_be_visible()
        expect(status).to_contain_text(re.compile("link (good|weak)"))
        assert pose(app) == pytest.approx(stood, abs=1e-3)
        assert live.recorder.status.frames >= frames > 1

        hold_key(app, page, "d", lambda: abs(float(pose(app)[2] - stood[2])) > 0.3)
        page.get_by_role("button", name=re.compile("^Keep")).click()
        until(lambda: not live.recorder.is_on)
        assert len(Recording.open(next(folder.glob("*.rrd"))).frames) > frames
    finally:
        router.kill()
        router.join()
