"""What a person may ask when, and what becomes of it; without a browser."""

import signal

import numpy as np
import pytest

from ltvn_core.graph.deltas import Cause, EdgePruned
from ltvn_core.navigation.events import Outcome, Severity
from ltvn_core.types import ZERO_TWIST, Twist
from ltvn_viz.wishes import commands as c
from ltvn_viz.wishes.modes import Mode
from tests.viz.session_harness import SessionHarness, said

FORWARD = Twist(0.4, 0.0)


def test_a_node_is_reached_and_the_verdict_is_shown(harness: SessionHarness) -> None:
    harness.do(c.Ask(c.Action.GOAL, harness.far_node))
    assert harness.session.state.activity.mode is Mode.NAVIGATING
    shown = harness.until(lambda now: now.mode is Mode.TELEOP)
    assert shown.moment.progress.ended is not None
    assert shown.moment.progress.ended.outcome is Outcome.ARRIVED
    assert shown.moment.progress.judged is not None
    assert shown.moment.progress.judged.reached


def test_on_the_way_the_images_of_subgoal_and_goal_are_at_hand_and_afterwards_none_is_shown(
    harness: SessionHarness,
) -> None:
    goal = harness.far_node
    harness.do(c.Ask(c.Action.GOAL, goal))
    way = harness.until(lambda now: now.way is not None and now.way.next is not None).way
    assert way is not None
    assert way.goal == goal
    assert all(harness.state.goals.thumbnails.get(node) for node in way if node is not None)
    assert harness.until(lambda now: now.mode is Mode.TELEOP).way is None


def test_what_is_not_possible_is_said_again_when_it_is_asked_again_and_is_no_trouble_of_the_app(
    harness: SessionHarness,
) -> None:
    harness.state.clock = lambda: 0.0
    first = harness.do(c.Ask(c.Action.GOAL, None)).message
    assert harness.do(c.Ask(c.Action.GOAL, None)).message == first  # An error that repeats at every tick is said once.
    harness.state.clock = lambda: 60.0
    second = harness.do(c.Ask(c.Action.GOAL, None)).message
    assert first is not None
    assert second is not None
    assert "Choose a goal" in second.text
    assert (second.text, second.number) == (first.text, first.number + 1)
    assert second.severity is Severity.WARN


def test_letting_go_stops_the_robot_at_once(harness: SessionHarness) -> None:
    harness.driver.twist = FORWARD
    harness.wait(5)
    assert harness.robot.twist == FORWARD
    harness.driver.twist = None
    harness.wait()
    assert harness.robot.twist == ZERO_TWIST


def test_a_paused_robot_stands_until_it_is_told_to_go_on(harness: SessionHarness) -> None:
    harness.do(c.Ask(c.Action.GOAL, harness.far_node), ticks=10)
    harness.do(c.Ask(c.Action.PAUSE), ticks=10)
    assert harness.now.mode is Mode.PAUSED
    where = harness.robot.pose.copy()
    harness.wait(30)
    np.testing.assert_array_equal(harness.robot.pose, where)
    harness.do(c.Ask(c.Action.PAUSE))
    harness.until(lambda now: now.mode is Mode.TELEOP)
    assert not np.array_equal(harness.robot.pose, where)


def test_a_step_is_one_control_step_and_then_a_pause(harness: SessionHarness) -> None:
    harness.do(c.Ask(c.Action.GOAL, harness.far_node), ticks=10)
    harness.do(c.Ask(c.Action.PAUSE), ticks=10)
    before = harness.robot.step
    harness.do(c.Ask(c.Action.STEP), ticks=30)
    assert harness.now.mode is Mode.PAUSED
    assert harness.robot.step == before + 1


def test_picking_a_node_goes_there_when_idle_and_only_chooses_it_on_the_way(harness: SessionHarness) -> None:
    first, second = harness.far_node, int(harness.now.moment.graph.ids[0])
    harness.do(c.Ask(c.Action.PICK, first))
    shown = harness.do(c.Ask(c.Action.PICK, second))
    assert shown.mode is Mode.NAVIGATING
    assert shown.moment.progress.goal == first
    assert shown.selected == second


def test_a_goal_outside_the_map_is_a_clear_error(harness: SessionHarness) -> None:
    shown = harness.do(c.Ask(c.Action.GOAL, 99_999))
    assert shown.mode is Mode.TELEOP
    assert "99999" in said(shown)


def test_a_failing_robot_is_stopped_and_the_page_says_so(
    harness: SessionHarness, caplog: pytest.LogCaptureFixture
) -> None:
    harness.do(c.Ask(c.Action.GOAL, harness.far_node), ticks=10)
    harness.do(c.Ask(c.Action.RECORD), ticks=5)
    stops = harness.robot.stops
    harness.robot.broken = RuntimeError("wheel fell off")
    harness.wait(5)
    harness.robot.broken = None
    shown = harness.wait()
    assert harness.robot.stops > stops
    assert shown.mode is Mode.TELEOP
    assert "wheel fell off" in said(shown)
    assert shown.recording.name is not None
    assert "the session failed" in caplog.text


def test_hammering_all_commands_breaks_nothing(harness: SessionHarness) -> None:
    rng = np.random.default_rng(3)
    nodes = harness.now.moment.graph.ids
    for _ in range(60):
        made = [
            c.Ask(c.Action.GOAL, int(rng.choice(nodes))),
            c.Ask(c.Action.PICK, int(rng.choice(nodes))),
            c.Ask(c.Action.SELECT, int(rng.choice(nodes))),
            c.NavigateToImage(np.zeros((72, 96, 3), np.uint8)),
            c.OpenRecording("nothing.rrd"),
            c.Seek(1.0),
            c.ReportError("broken upload"),
            *(c.Ask(action) for action in c.Action if action.wish.takes is None),
        ]
        harness.driver.twist = FORWARD if rng.random() < 0.1 else None
        picked = rng.choice(len(made), size=3)
        shown = harness.do(*(made[k] for k in picked), ticks=int(rng.integers(1, 4)))
        assert "went wrong" not in said(shown)
    harness.driver.twist = None
    harness.do(c.Ask(c.Action.STOP), c.Ask(c.Action.CLOSE), ticks=5)
    assert harness.session.state.activity.mode is Mode.TELEOP


@pytest.mark.slow
def test_a_flood_of_commands_is_bounded(harness: SessionHarness, caplog: pytest.LogCaptureFixture) -> None:
    for _ in range(10_000):
        harness.session.send(c.Ask(c.Action.STOP))
    assert "too many commands" in caplog.text
    harness.wait()
    assert harness.session.state.activity.mode is Mode.TELEOP


def test_a_picture_that_is_like_no_node_is_told_of_and_only_suggested(harness: SessionHarness) -> None:
    noise = np.random.default_rng(1).integers(0, 255, (72, 96, 3), np.uint8)
    shown = harness.do(c.NavigateToImage(noise), ticks=3)
    assert shown.mode is Mode.TELEOP
    assert shown.message is not None
    assert "not found" in shown.message.title
    assert shown.selected is None
    assert shown.upload is not None
    harness.do(c.Ask(c.Action.SELECT, shown.upload.places[0].node), ticks=1)
    assert harness.session.state.activity.mode is Mode.NAVIGATING


def test_a_goal_without_a_way_is_told_of_before_the_robot_drives(harness: SessionHarness) -> None:
    goal = harness.far_node
    graph = harness.session.state.live_map.graph
    edges = [key for key in graph.edges if goal in key]
    harness.session.state.live_map.change([EdgePruned(*key, Cause.HAND) for key in edges])
    shown = harness.do(c.Ask(c.Action.GOAL, goal), ticks=1)
    assert f"does not contain goal {goal}" in said(shown)
    assert "Nearest to it is node" in said(shown)


def test_the_session_runs_in_real_time_until_told_to_stop(harness: SessionHarness) -> None:
    harness.session.run(max_ticks=3)
    assert len(harness.shown) >= 4
    assert harness.robot.twist == ZERO_TWIST


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="Windows has no timer that sends signals")
def test_a_signal_may_wake_the_session_at_any_moment(harness: SessionHarness) -> None:
    before = signal.signal(signal.SIGALRM, lambda number, frame: harness.session.wake())
    signal.setitimer(signal.ITIMER_REAL, 0.0005, 0.0005)
    try:
        harness.session.run(max_ticks=60)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    assert len(harness.shown) >= 60


def test_a_rebuilt_map_says_what_changed_and_the_old_one_comes_back(harness: SessionHarness) -> None:
    graph = harness.state.live_map.graph
    old = sorted(graph.nodes), sorted(graph.edges)
    harness.do(c.Ask(c.Action.BUILD))
    shown = harness.until(lambda now: now.mode is Mode.TELEOP and now.can_undo_build)
    rebuilt = harness.state.live_map.graph
    assert f"{len(old[0]):,} → {len(rebuilt.nodes):,} nodes" in said(shown)
    assert "Undo" in said(shown)
    harness.do(c.Ask(c.Action.UNDO_BUILD))
    shown = harness.until(lambda now: not now.can_undo_build)
    back = harness.state.live_map.graph
    assert (sorted(back.nodes), sorted(back.edges)) == old
    assert sorted(shown.moment.graph.ids.tolist()) == old[0]
    assert len(shown.moment.graph.p) == len(old[1])
    again = harness.do(c.Ask(c.Action.UNDO_BUILD))
    assert "no map to bring back" in said(again)


def test_one_may_drive_and_navigate_by_the_map_that_came_back(harness: SessionHarness) -> None:
    harness.do(c.Ask(c.Action.BUILD))
    harness.until(lambda now: now.can_undo_build)
    harness.do(c.Ask(c.Action.UNDO_BUILD))
    shown = harness.until(lambda now: not now.can_undo_build)
    harness.do(c.Ask(c.Action.GOAL, int(shown.moment.graph.ids[-1])))
    ended = harness.until(lambda now: now.moment.progress.ended is not None).moment.progress.ended
    assert ended is not None
    assert ended.outcome is Outcome.ARRIVED
