"""Watch it learn, in a real browser, in the shipped map."""

from collections.abc import Iterator

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from ltvn_core.navigation.events import Outcome, QueryEnded
from ltvn_viz.app import AppOptions, RunningApp
from ltvn_viz.session.story_teller import StoryTeller
from ltvn_viz.wishes.modes import Mode
from tests.browser import newcomer
from tests.browser.actions import wait_for_rest
from tests.browser.running_app import running_app
from tests.waiting import until

pytest.importorskip("embreex")
pytestmark = [pytest.mark.browser, pytest.mark.slow]

FIRST_GOAL_S = 45.0
"""Robot time after which somebody who waits for the first goal may lose patience."""
STEPS = 30


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningApp]:
    with running_app(AppOptions(port=0, recordings=tmp_path_factory.mktemp("recordings"))) as app:
        yield app


def told(app: RunningApp) -> StoryTeller:
    story = app.session.state.story
    assert story is not None
    return story


def test_stop_between_two_parts_ends_the_story_and_the_robot_moves_no_more(app: RunningApp, page: Page) -> None:
    newcomer.begin_story(page)
    expect(page.locator(".ltvn-status")).to_contain_text("The story continues")
    assert app.session.state.activity.mode is Mode.TELEOP
    page.keyboard.press("Space")
    until(lambda: told(app).is_over)
    expect(page.get_by_role("button", name="Watch it learn")).to_be_enabled()
    robot, queries = app.session.state.live.robot, app.session.state.queries
    where, since = robot.drawn_pose, robot.state().step
    until(lambda: robot.state().step > since + STEPS)
    np.testing.assert_array_equal(robot.drawn_pose, where)
    assert app.session.state.queries == queries


def test_a_newcomer_reaches_a_goal_and_then_one_button_tells_how_the_map_learns(app: RunningApp, page: Page) -> None:
    wait_for_rest(app)
    newcomer.reach_first_goal(app, page)
    wait_for_rest(app)
    assert newcomer.first_query_s(app) < FIRST_GOAL_S
    newcomer.begin_story(page)
    newcomer.wait_for_mark(page, newcomer.NEW)
    newcomer.wait_for_mark(page, newcomer.FADED)
    page.get_by_text("Learnt:").first.wait_for()
    until(lambda: told(app).is_over)
    wait_for_rest(app)
    captions = "\n".join(told(app).captions)
    order = ("New nodes appear", "prunes it", "closes the door", "edges through it fade", "The plan changes")
    places = [captions.find(each) for each in (*order, "is opened", "edges return", "Learnt:", "arrived")]
    assert -1 not in places[:-1]
    assert places[:-1] == sorted(places[:-1])
    facts = told(app).story.facts
    assert facts.rerouted
    assert facts.returned
    assert facts.pruned
    events = [stamped.event for stamped in app.session.state.live.timeline.events]
    assert [each for each in events if isinstance(each, QueryEnded)][-1].outcome is Outcome.ARRIVED
    expect(page.get_by_role("button", name="Watch it learn")).to_be_enabled()
