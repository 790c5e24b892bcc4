"""When an edge is open, why the robot tried it, and what changed since: live and in replay, with moments to go to."""

from pathlib import Path

import pytest

from ltvn_core import palette
from ltvn_core.analysis.answer import PresenceChart
from ltvn_core.graph.deltas import PoseRow
from ltvn_core.navigation.events import AttemptEnd, AttemptEnded, AttemptStarted, QueryStarted, WorldChanged
from ltvn_core.worlds import DoorMoved
from ltvn_viz.session.inspection import QuestionName
from ltvn_viz.session.snapshot import Snapshot
from ltvn_viz.wishes import commands as c
from ltvn_viz.wishes.commands import Mode
from tests.viz.debugger.answer_links import answer_of, follow, links, words
from tests.viz.debugger.seen_edges import HOUR, open_harness, see
from tests.viz.session_harness import SessionHarness, said


@pytest.fixture
def harness(tmp_path: Path) -> SessionHarness:
    """A live map whose plans look at presence; it is 8 o'clock."""
    return open_harness(tmp_path)


def looks_of(snapshot: Snapshot) -> list[bool]:
    """Return whether each look at the edge on show found it open, oldest first."""
    charts = [block for block in answer_of(snapshot).blocks if isinstance(block, PresenceChart)]
    return [look.is_open for chart in charts for look in chart.looks]


def test_presence_is_told_of_once_something_was_seen_blocked(harness: SessionHarness) -> None:
    edge = harness.an_edge
    before = words(harness.do(c.Ask(c.Action.QUESTION, QuestionName.EDGE), ticks=2))
    see(harness, edge, 8 * HOUR + 60, present=False)
    after = words(harness.do(c.Ask(c.Action.QUESTION, QuestionName.EDGE), ticks=2))
    assert "seen blocked" not in before
    assert "1 edge was seen blocked" in after
    assert f"{edge[0]} → {edge[1]}" in after


def test_the_strip_shows_what_was_seen_and_what_is_expected(harness: SessionHarness) -> None:
    source, target = harness.an_edge
    see(harness, (source, target), 8 * HOUR + 60, present=False)
    see(harness, (source, target), 8 * HOUR + 1200, present=True)
    see(harness, (source, target), 9 * HOUR, present=False)
    listed = harness.do(c.Ask(c.Action.QUESTION, QuestionName.EDGE), ticks=3)
    shown = follow(harness, listed, f"{source} → {target}")
    told = words(shown)
    assert looks_of(shown) == [False, True, False]
    assert "p open" in told
    assert "09:00" in told
    assert "in an hour" in told
    assert "tomorrow at this time" in told
    assert "open again from day" in told


def test_of_an_edge_that_was_met_blocked_but_is_not_followed_no_one_says_it_was_never_blocked(
    harness: SessionHarness,
) -> None:
    edge, live = harness.an_edge, harness.state.live
    live.emit(QueryStarted(1, edge[1]))
    live.emit(AttemptStarted(1, 1, *edge, edge[0], PoseRow(1.0, 0.0, 0.0), 0.9))
    live.emit(
        AttemptEnded(1, 1, *edge, edge[0], AttemptEnd.BLOCKED, 2.0, 0.1, succeeded=False, reason="something is there")
    )
    told = words(harness.do(c.Ask(c.Action.QUESTION, QuestionName.EDGE), c.PointAt(*edge), ticks=15))
    assert "failed (blocked)" in told
    assert "blocked it in 1 attempt" in told
    assert "never seen blocked" not in told


def test_a_strip_tells_what_was_known_at_the_moment_of_a_replay(harness: SessionHarness) -> None:
    edge = harness.an_edge
    harness.do(c.Ask(c.Action.RECORD), ticks=3)
    harness.driver.twist = None
    see(harness, edge, 8 * HOUR + 60, present=False)
    harness.wait(10)
    see(harness, edge, 9 * HOUR, present=True)
    harness.do(c.Ask(c.Action.KEEP), ticks=2)
    name = harness.writers[-1].path.name
    shown = harness.do(
        c.OpenRecording(name, 1e9), c.Ask(c.Action.QUESTION, QuestionName.EDGE), c.PointAt(*edge), ticks=4
    )
    assert shown.mode is Mode.REPLAY
    assert looks_of(shown) == [False, True]
    first = [number for number, label in links(shown) if label.endswith(" s")][-1]
    earlier = harness.do(c.Ask(c.Action.FOLLOW, first), ticks=4)
    assert looks_of(earlier) == [False]


def test_why_it_went_around_is_told_for_a_plan_over_an_edge_that_was_seen_blocked(harness: SessionHarness) -> None:
    graph = harness.state.live_map.graph
    goal = max(graph.nodes)
    harness.do(c.Ask(c.Action.GOAL, goal))
    harness.until(lambda snapshot: snapshot.mode is Mode.TELEOP)
    plan = max((each.planned.nodes for each in harness.state.live.timeline.plans), key=len)
    harness.do(c.Ask(c.Action.GOAL, plan[0]))
    harness.until(lambda snapshot: snapshot.mode is Mode.TELEOP)
    see(harness, (plan[0], plan[1]), 9 * HOUR, present=False)
    see(harness, (plan[-2], plan[-1]), 9 * HOUR, present=False)
    harness.do(c.Ask(c.Action.GOAL, goal))
    harness.until(lambda snapshot: snapshot.mode is Mode.TELEOP)
    shown = harness.do(c.Ask(c.Action.QUESTION, QuestionName.EDGE), ticks=3)
    assert "was open with p = 0." in words(shown)
    assert "Why did the robot" in words(shown)
    assert palette.EDGE_REMOVED in {stroke.colour for stroke in shown.inspection.answer.overlay.strokes}


def test_the_plan_at_another_time_of_day_is_drawn_with_what_would_be_open(harness: SessionHarness) -> None:
    nodes = sorted(harness.state.live_map.graph.nodes)
    harness.do(c.Ask(c.Action.QUESTION, QuestionName.WHAT_IF), c.Ask(c.Action.TELL, f"from {nodes[0]}"), ticks=2)
    shown = harness.do(c.Ask(c.Action.TELL, f"goal {nodes[-1]}"), c.Ask(c.Action.TELL, "belief weight = 2"), ticks=3)
    see(harness, harness.an_edge, 9 * HOUR, present=False)
    shown = harness.do(ticks=15)
    assert "It is day 1, 09:00" in words(shown)
    shown = follow(harness, shown, "at 18:00", ticks=4)
    assert "at 18:00 · forget" in words(shown)
    assert "It would be day 1, 18:00" in words(shown)
    assert "would count as open, now 0" in words(shown)


def test_what_changed_since_an_hour_ago_names_doors_and_edges(harness: SessionHarness) -> None:
    source, target = harness.an_edge
    harness.wait(3)
    harness.state.live.emit(WorldChanged(DoorMoved(2, is_open=False), at_s=10 * HOUR))
    see(harness, (source, target), 10 * HOUR + 60, present=False)
    listed = harness.do(c.Ask(c.Action.QUESTION, QuestionName.COMPARE), ticks=15)
    shown = follow(harness, listed, "an hour ago", ticks=4)
    html = words(shown)
    assert "closed here, not there: 1" in html
    assert f"{source} → {target}" in html
    assert "In the world: door 2 closed." in html
    assert "yesterday at this time" not in words(listed)


def test_a_time_may_be_typed_and_one_to_come_is_refused(harness: SessionHarness) -> None:
    see(harness, harness.an_edge, 10 * HOUR, present=False)
    harness.do(c.Ask(c.Action.QUESTION, QuestionName.COMPARE), ticks=2)
    refused = harness.do(c.Ask(c.Action.TELL, "day 1 23:00"))
    assert "It is only day 1, 10:00" in said(refused)
    shown = harness.do(c.Ask(c.Action.TELL, "9:00"), ticks=4)
    assert "closed here, not there: 1" in words(shown)
