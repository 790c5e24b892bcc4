"""The main job as a person does it, in a real browser: demo apartment, ready-made map, shipped network."""

from collections.abc import Iterator, Sequence

import numpy as np
import pytest
from playwright.sync_api import Browser, Page

from ltvn_core.evaluation.query_run import judge_goal_reached
from ltvn_core.navigation.events import Outcome
from ltvn_core.types import NodeId, Pose
from ltvn_viz.app import AppOptions, RunningApp
from ltvn_viz.timeline.run_moment import moment_of
from ltvn_viz.wishes.modes import Mode
from tests.browser.actions import click_goal_image, wait_for_rest
from tests.browser.pages import is_bare_map, on_screen, open_page
from tests.browser.running_app import running_app
from tests.waiting import PATIENCE_S, until

pytestmark = pytest.mark.browser

TRIP_S = 2 * PATIENCE_S
"""A robot drives in real time, and a page drawn by software slows it down further."""
NOT_HERE_M = 0.8
"""A robot that is nearer to a node has no way to go."""
NEAR_M = 3.0
"""A longer way would show nothing more."""


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningApp]:
    options = AppOptions(port=0, recordings=tmp_path_factory.mktemp("recordings"), seed=1)
    with running_app(options) as app:
        yield app


@pytest.fixture(scope="module")
def page(app: RunningApp, chromium: Browser) -> Iterator[Page]:
    with open_page(chromium, app.server.url, width=900, height=600, draws=False) as page:
        page.get_by_text("Next:").wait_for()
        yield page


def exact_pose(app: RunningApp, node: NodeId) -> Pose:
    pose = app.session.state.live_map.keyframes.observation(node).exact_pose
    assert pose is not None
    return pose


def assert_the_robot_goes_to(app: RunningApp, node: NodeId) -> None:
    """Wait for the end of the task, and judge it by the paper's criterion."""
    until(lambda: app.session.state.activity.mode is Mode.TELEOP, patience_s=TRIP_S)
    ended = moment_of(app.session.state.live.timeline).progress.ended
    assert ended is not None
    assert (ended.goal, ended.outcome) == (node, Outcome.ARRIVED)
    verdict = judge_goal_reached(0, app.session.state.live.robot.drawn_pose, exact_pose(app, node))
    assert verdict.reached, verdict


def test_an_image_of_the_ready_made_maps_gallery_is_reached(app: RunningApp, page: Page) -> None:
    assert len(app.session.state.live_map.graph.nodes) > 100
    page.get_by_role("tab", name="Go").click()
    robot = app.session.state.live.robot.drawn_pose[:2]

    def near_but_not_here(offered: Sequence[NodeId]) -> NodeId:
        away = {node: float(np.linalg.norm(exact_pose(app, node)[:2] - robot)) for node in offered}
        return min((node for node in offered if away[node] > NOT_HERE_M), key=away.__getitem__)

    goal = click_goal_image(app, page, near_but_not_here)
    until(lambda: app.session.state.activity.mode is Mode.NAVIGATING)
    assert_the_robot_goes_to(app, goal)


def test_a_node_clicked_in_the_scene_is_reached(app: RunningApp, page: Page) -> None:
    wait_for_rest(app)
    nodes = list(app.session.state.live_map.graph.nodes)
    places = np.array([exact_pose(app, node)[:2] for node in nodes])
    robot = app.session.state.live.robot.drawn_pose[:2]
    alone = np.sort(np.linalg.norm(places[:, None] - places, axis=-1), axis=1)[:, 1]
    away = np.linalg.norm(places - robot, axis=1)
    alone[(away < NOT_HERE_M) | (away > NEAR_M)] = 0
    shown = ((row, on_screen(page, *places[row])) for row in np.argsort(-alone))
    row, point = next((row, point) for row, point in shown if is_bare_map(page, point))
    page.mouse.click(*point)
    until(lambda: app.session.state.activity.mode is Mode.NAVIGATING)
    assert_the_robot_goes_to(app, nodes[row])
