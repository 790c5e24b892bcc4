"""A person joins two floors by a lift, sends the robot to the other one, and takes the lift with it."""

from collections.abc import Iterator

import pytest
from playwright.sync_api import Page, expect

from ltvn_core.navigation.events import Outcome
from ltvn_viz.session.inspection import QuestionName
from ltvn_viz.wishes import commands as c
from ltvn_viz.wishes.modes import Mode
from tests.browser.actions import press, wait_for_rest
from tests.browser.flat_app import FlatApp, serving, until_shown
from tests.viz.two_floors import LIFT, lift_ends, nearest, split_rooms

pytestmark = pytest.mark.browser


@pytest.fixture
def app(tmp_path_factory: pytest.TempPathFactory) -> Iterator[FlatApp]:
    with serving(tmp_path_factory.mktemp("recordings")) as app:
        app.session.send(split_rooms(app.harness))
        yield app


def test_a_lift_is_written_down_waited_for_and_done(app: FlatApp, page: Page) -> None:
    wait_for_rest(app)
    harness = app.harness
    source, target = lift_ends(harness)
    app.session.send(c.Ask(c.Action.QUESTION, QuestionName.HAND))
    app.session.send(c.Ask(c.Action.PICK, source))
    app.session.send(c.Ask(c.Action.PICK, target))
    page.get_by_role("tab", name="Why").click()
    page.locator("a, button", has_text="by an action").first.click()
    until_shown(app, lambda now: now.inspection.answer.input_hint.startswith("Action"))
    page.get_by_text("Action from").wait_for()
    page.locator("input:not([readonly]):visible, textarea:visible").last.fill(LIFT)
    press(page, "Change the map", lambda: harness.now.floor is not None)

    app.session.send(c.Ask(c.Action.QUESTION, QuestionName.FIRST))
    app.session.send(c.Ask(c.Action.GOAL, nearest(harness, 5.0, 3.0)))
    until_shown(app, lambda now: now.waiting is not None)
    expect(page.get_by_text(f"waits at node {source}: {LIFT}").first).to_be_visible()
    there = harness.state.live_map.keyframes.observation(target).exact_pose
    assert there is not None
    harness.robot.put_down(there.tolist(), harness.robot.state().odometry.tolist())
    press(page, "Done", lambda: harness.now.waiting is None)
    ended = until_shown(app, lambda now: now.mode is Mode.TELEOP).moment.progress.ended
    assert ended is not None
    assert ended.outcome is Outcome.ARRIVED
    page.get_by_role("tab", name="World").click()
    press(page, "Floor 2", lambda: harness.now.floor is not None and not harness.now.floor.follows_robot)
