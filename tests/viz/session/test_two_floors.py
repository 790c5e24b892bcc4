"""Two rooms that are two floors: the page shows one, and asks a person for the action that leads to the other.

It shows the robot's floor or the one that the person chose; a query waits for the answer about the action.
"""

from pathlib import Path

import pytest

from ltvn_core.navigation.action_performer import ActionState
from ltvn_core.navigation.events import ActionEnded, Outcome
from ltvn_core.types import NodeId, Pose
from ltvn_viz.session.snapshot import Snapshot
from ltvn_viz.wishes import commands as c
from ltvn_viz.wishes.modes import Mode
from tests.viz.session_harness import SessionHarness
from tests.viz.two_floors import LIFT, add_lift, is_in_first_room, lift_ends, nearest, open_two_rooms


@pytest.fixture
def floors(tmp_path: Path) -> SessionHarness:
    """Two floors, joined by a lift."""
    harness = open_two_rooms(tmp_path)
    harness.do(add_lift(harness), ticks=2)
    return harness


@pytest.fixture
def harness(floors: SessionHarness) -> SessionHarness:
    """A robot that waits for the lift."""
    harness = floors
    harness.do(c.Ask(c.Action.GOAL, nearest(harness, 5.0, 3.0)))
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
    harness.do(c.Ask(c.Action.END_ACTION, 1))
    assert outcome(harness) is Outcome.ARRIVED


def test_an_action_that_failed_is_not_tried_again(harness: SessionHarness) -> None:
    harness.do(c.Ask(c.Action.END_ACTION, 0))
    harness.until(lambda now: now.waiting is None)
    assert harness.wait(50).waiting is None
    events = [stamped.event for stamped in harness.state.live.timeline.events]
    assert [event.succeeded for event in events if isinstance(event, ActionEnded)] == [False]


def test_an_answer_that_comes_before_the_action_is_not_taken_for_it(harness: SessionHarness) -> None:
    harness.do(c.Ask(c.Action.CANCEL))
    outcome(harness)
    carry(harness, nearest(harness, 1.0, 1.0))
    harness.do(c.Ask(c.Action.GOAL, nearest(harness, 5.0, 3.0)), c.Ask(c.Action.END_ACTION, 0))
    assert harness.until(lambda now: now.waiting is not None).waiting is not None
    assert harness.wait(20).waiting is not None


def rooms(harness: SessionHarness, shown: Snapshot) -> set[bool]:
    return {is_in_first_room(harness, node) for node in shown.moment.graph.ids.tolist()}


def test_one_floor_is_shown_with_its_own_edges_and_its_exit(floors: SessionHarness) -> None:
    shown = floors.now
    graph = shown.moment.graph
    assert shown.floor is not None
    assert (shown.floor.floor, shown.floor.floors) == (0, 2)
    assert len(rooms(floors, shown)) == 1
    assert graph.edges.max() < len(graph.ids)
    assert not graph.acts.any()
    driven = floors.state.live_map.graph.driven_edges
    on_it = {key for key in driven if {*key} <= set(graph.ids.tolist())}
    assert {(int(graph.ids[a]), int(graph.ids[b])) for a, b in graph.edges} == on_it


def test_a_person_chooses_a_floor_and_goes_back_to_the_robots(floors: SessionHarness) -> None:
    floors.do(c.Ask(c.Action.GOAL, nearest(floors, 1.0, 2.0)))
    floors.until(lambda now: now.moment.progress.localised is not None)
    robots = floors.wait(2).moment.graph
    assert rooms(floors, floors.now) == {True}
    assert robots.exits.sum() == 1
    assert int(robots.ids[robots.exits][0]) == lift_ends(floors)[0]
    assert floors.now.floor is not None
    other = floors.do(c.Ask(c.Action.SHOW_FLOOR, 1 - floors.now.floor.floor))
    assert rooms(floors, other) == {False}
    assert floors.wait().moment.graph is other.moment.graph
    assert other.moment.robot is None
    back = floors.do(c.Ask(c.Action.SHOW_FLOOR))
    assert rooms(floors, back) == {True}
    assert back.moment.robot is not None


def test_a_map_of_one_floor_is_shown_whole(tmp_path: Path) -> None:
    harness = open_two_rooms(tmp_path)
    shown = harness.wait()
    assert shown.floor is None
    assert rooms(harness, shown) == {True, False}
