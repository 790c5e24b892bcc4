"""Where an edge has an action, the page asks the person to do it, and the query waits for the answer."""

from pathlib import Path

import pytest

from ltvn_core.navigation.action_performer import ActionState
from ltvn_core.navigation.events import ActionEnded, Outcome
from ltvn_core.types import NodeId, Pose
from ltvn_viz.wishes import commands as c
from ltvn_viz.wishes.commands import Mode
from tests.viz.session_harness import SessionHarness
from tests.viz.two_floors import LIFT, add_lift, lift_ends, nearest, open_two_rooms


@pytest.fixture
def harness(tmp_path: Path) -> SessionHarness:
    """Two floors, and a robot that waits for the lift between them."""
    harness = open_two_rooms(tmp_path)
    harness.do(add_lift(harness))
    harness.do(c.NavigateTo(nearest(harness, 5.0, 3.0)))
    harness.until(lambda _: harness.state.actions.state() is ActionState.PENDING)
    return harness


def carry(harness: SessionHarness, node: NodeId) -> None:
    """Put the robot down at a node, as a person does who takes the lift with it."""
    pose: Pose | None = harness.state.live_map.keyframes.observation(node).exact_pose
    assert pose is not None
    harness.robot.put_down(pose.tolist(), harness.robot.state().odometry.tolist())


def outcome(harness: SessionHarness) -> Outcome:
    ended = harness.until(lambda now: now.mode is Mode.TELEOP).moment.progress.ended
    assert ended is not None
    return ended.outcome


def test_the_robot_waits_while_the_page_says_what_to_do_and_drives_on_when_it_is_done(harness: SessionHarness) -> None:
    source, target = lift_ends(harness)
    shown = harness.wait(100)
    assert shown.waiting is not None
    assert (LIFT in shown.hint, f"node {source}" in shown.hint) == (True, True)
    carry(harness, target)
    harness.do(c.EndAction(succeeded=True))
    assert outcome(harness) is Outcome.ARRIVED


def test_an_action_that_failed_is_not_tried_again(harness: SessionHarness) -> None:
    harness.do(c.EndAction(succeeded=False))
    harness.until(lambda now: now.waiting is None)
    assert harness.wait(50).waiting is None
    events = [stamped.event for stamped in harness.state.live.timeline.events]
    assert [event.succeeded for event in events if isinstance(event, ActionEnded)] == [False]


def test_cancel_ends_the_wait(harness: SessionHarness) -> None:
    harness.do(c.Cancel())
    assert outcome(harness) is Outcome.CANCELLED
    assert harness.now.waiting is None


def test_an_answer_that_comes_before_the_action_is_not_taken_for_it(harness: SessionHarness) -> None:
    harness.do(c.Cancel())
    outcome(harness)
    carry(harness, nearest(harness, 1.0, 1.0))
    harness.do(c.NavigateTo(nearest(harness, 5.0, 3.0)), c.EndAction(succeeded=False))
    assert harness.until(lambda now: now.waiting is not None).waiting is not None
    assert harness.wait(20).waiting is not None
