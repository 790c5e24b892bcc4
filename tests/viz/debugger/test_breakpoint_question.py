"""Stopping where a person asked for it, live and in a recording."""

import pytest

from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import MarkKind
from ltvn_core.graph.deltas import Belief, Cause, Edge, EdgeAdded, EdgePruned, Node, NodeAdded, NodeDropped, PoseRow
from ltvn_core.navigation import events as e
from ltvn_core.types import NodeId
from ltvn_viz.session.inspection import QuestionName
from ltvn_viz.session.snapshot import Snapshot
from ltvn_viz.timeline.breakpoint_monitor import Breakpoint, BreakpointMonitor
from ltvn_viz.wishes import commands as c
from ltvn_viz.wishes.modes import Mode
from tests.viz.debugger.answer_links import follow, words
from tests.viz.session_harness import SessionHarness, said

HERE = PoseRow(0.0, 0.0, 0.0)
STORY: list[e.Event] = [
    e.GraphChanged(NodeAdded(Node(1, HERE), Cause.BUILD)),
    e.GraphChanged(NodeAdded(Node(2, HERE), Cause.BUILD)),
    e.GraphChanged(EdgeAdded(Edge(1, 2, HERE, Belief(0.8, 1.0, 0.1)), Cause.BUILD)),
    e.QueryStarted(0, 3),  # 3
    e.Planned(0, (1, 2, 3), 2.0),
    e.AttemptStarted(0, 1, 1, 2, 4, HERE, 0.9),  # 5
    e.Collided(0, 1),
    e.AttemptEnded(0, 1, 1, 2, 5, e.AttemptEnd.COLLISION, 1.0, 0.2, succeeded=False, reason="not connectable"),  # 7
    e.Planned(0, (2, 3), 1.0),
    e.Planned(0, (2, 9, 3), 3.0),  # 9
    e.GraphChanged(NodeAdded(Node(9, HERE), Cause.EXPAND)),
    e.GraphChanged(EdgePruned(1, 2, Cause.ATTEMPT)),  # 11
    e.GraphChanged(NodeDropped(2, Cause.HAND)),
    e.QueryEnded(0, 3, e.Outcome.NO_PATH, 9, 1, 2.0),  # 13
    e.QueryStarted(1, 1),
]


@pytest.fixture
def harness(harness: SessionHarness) -> SessionHarness:
    """A live map of one room with the breakpoints on show."""
    harness.do(c.Ask(c.Action.QUESTION, QuestionName.BREAK))
    return harness


def driven(harness: SessionHarness) -> str:
    """Record a drive through the room and return the recording's name."""
    harness.do(c.Ask(c.Action.RECORD), c.Ask(c.Action.GOAL, harness.far_node))
    harness.until(lambda snapshot: snapshot.mode is Mode.TELEOP)
    harness.do(c.Ask(c.Action.KEEP))
    return harness.writers[-1].path.name


def played(harness: SessionHarness) -> Snapshot:
    harness.do(c.Ask(c.Action.PAUSE))
    return harness.until(lambda snapshot: snapshot.replay is not None and not snapshot.timeline.is_playing)


@pytest.mark.parametrize(
    ("kind", "ids", "steps"),
    [
        (MarkKind.PRUNE, (), [11, 12]),
        (MarkKind.PRUNE, (1, 2), [11]),
        (MarkKind.PRUNE, (2, 1), []),
        (MarkKind.PRUNE, (2,), [11, 12]),
        (MarkKind.EXPAND, (), [10]),
        (MarkKind.COLLISION, (), [6]),
        (MarkKind.FAILURE, (1, 2), [7]),
        (MarkKind.FAILURE, (1,), [7]),
        (MarkKind.FAILURE, (77, 78), []),
        (MarkKind.REPLAN, (), [9]),
        (MarkKind.QUERY_START, (), [3, 14]),
        (MarkKind.QUERY_START, (1,), [14]),
        (MarkKind.QUERY_END, (), [13]),
    ],
)
def test_a_breakpoint_stops_there_and_nowhere_else_live_and_in_a_recording(
    kind: MarkKind, ids: tuple[NodeId, ...], steps: list[int]
) -> None:
    monitor, live, stopped = BreakpointMonitor(), Timeline(), []
    monitor.breakpoints = (Breakpoint(kind, ids),)
    for step, event in enumerate(STORY):
        live.append_event(e.StampedEvent(step, 0.1 * step, event))
        monitor.consume(live)
        if monitor.take_latest() is not None:
            stopped.append(step)
    recorded = [mark.instant.step for mark in monitor.stops_among(live.marks)]
    assert stopped == recorded == steps


def test_a_query_is_held_where_a_breakpoint_is_met_and_the_page_says_which(harness: SessionHarness) -> None:
    goal = harness.far_node
    follow(harness, harness.do(c.Ask(c.Action.PICK, goal)), f"new query at node {goal}")
    harness.do(c.Ask(c.Action.GOAL, goal))
    held = harness.until(lambda snapshot: snapshot.mode is not Mode.NAVIGATING)
    assert held.mode is Mode.PAUSED
    assert f"node {goal} is the goal" in said(held)
    assert "Met once" in words(held)


def test_a_held_query_goes_on_to_its_end_when_it_is_let_go(harness: SessionHarness) -> None:
    follow(harness, harness.do(ticks=2), "new query")
    harness.do(c.Ask(c.Action.GOAL, harness.far_node))
    held = harness.until(lambda snapshot: snapshot.mode is Mode.PAUSED)
    follow(harness, held, "remove", ticks=1)
    harness.do(c.Ask(c.Action.PAUSE))
    ended = harness.until(lambda snapshot: snapshot.mode is Mode.TELEOP)
    assert ended.moment.progress.ended is not None


def test_breakpoints_are_taken_away_one_by_one_by_their_links(harness: SessionHarness) -> None:
    both = follow(harness, follow(harness, harness.do(ticks=2), "prune"), "replan")
    one = follow(harness, both, "remove")
    assert "prune · remove" in words(both)
    assert "prune · remove" not in words(one)
    assert "replan · remove" in words(one)


def test_nothing_is_typed_to_set_a_breakpoint(harness: SessionHarness) -> None:
    shown = harness.do(c.Ask(c.Action.TELL, "prune"))
    assert not shown.inspection.answer.input_hint
    assert "follow a link" in said(shown)


def test_a_breakpoint_finds_what_the_live_run_met_before_it_was_set(harness: SessionHarness) -> None:
    harness.do(c.Ask(c.Action.GOAL, harness.far_node))
    harness.until(lambda snapshot: snapshot.mode is Mode.TELEOP)
    shown = follow(harness, harness.do(ticks=2), "end of a query")
    assert "Met once" in words(shown)
    assert shown.message is None or "Stopped" not in shown.message.text


def stopping_twice(harness: SessionHarness) -> Snapshot:
    """Open a drive in which each end of a query is a stop, and so is each beginning."""
    shown = harness.do(c.OpenRecording(driven(harness)), ticks=2)
    return follow(harness, follow(harness, shown, "new query"), "end of a query")


def test_a_replay_stops_at_each_hit_and_plays_on_from_there(harness: SessionHarness) -> None:
    stopping_twice(harness)
    first, second = played(harness), played(harness)
    assert 0 < first.timeline.time_s < second.timeline.time_s
    assert second.moment.progress.ended is not None
    assert "Stopped at" in said(second)


def test_links_lead_to_the_next_and_to_the_previous_hit_of_a_recording(harness: SessionHarness) -> None:
    end = follow(harness, stopping_twice(harness), "next")
    begin = follow(harness, end, "previous")
    again = follow(harness, begin, "next")
    assert begin.timeline.time_s < end.timeline.time_s == again.timeline.time_s


def test_an_offer_that_was_taken_is_offered_no_more(harness: SessionHarness) -> None:
    taken = follow(harness, harness.do(ticks=2), "collision")
    assert words(taken).count("collision") == 1
