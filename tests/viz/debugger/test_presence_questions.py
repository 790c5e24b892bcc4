"""When an edge is open, why the robot tried it, and what changed since: live and in replay, with moments to go to."""

from pathlib import Path

import pytest

from ltvn_core import palette
from ltvn_core.navigation.events import WorldChanged
from ltvn_core.worlds.world_change import DoorMoved
from ltvn_viz.session import commands as c
from ltvn_viz.session.inspection import QuestionName
from ltvn_viz.session.modes import Mode
from tests.viz.debugger.answer_links import follow, links
from tests.viz.debugger.seen_edges import HOUR, open_harness, see
from tests.viz.session_harness import SessionHarness


@pytest.fixture
def harness(tmp_path: Path) -> SessionHarness:
    """A live map whose plans look at presence; it is 8 o'clock."""
    return open_harness(tmp_path)


def an_edge(harness: SessionHarness) -> tuple[int, int]:
    """Return an edge."""
    return next(iter(harness.state.live_map.graph.edges))


def test_questions_about_presence_are_offered_once_something_was_seen_blocked(harness: SessionHarness) -> None:
    before = harness.do(ticks=2).inspection.offered
    see(harness, an_edge(harness), 8 * HOUR + 60, present=False)
    after = harness.do(ticks=2).inspection.offered
    assert {QuestionName.PRESENCE, QuestionName.TRIED}.isdisjoint(before)
    assert {QuestionName.PRESENCE, QuestionName.TRIED} <= set(after)
    assert [each for each in after if each in before] == list(before)


def test_the_strip_shows_what_was_seen_and_what_is_expected(harness: SessionHarness) -> None:
    source, target = an_edge(harness)
    see(harness, (source, target), 8 * HOUR + 60, present=False)
    see(harness, (source, target), 8 * HOUR + 1200, present=True)
    see(harness, (source, target), 9 * HOUR, present=False)
    listed = harness.do(c.ChooseQuestion(QuestionName.PRESENCE), ticks=3)
    shown = follow(harness, listed, f"{source} → {target}")
    html = shown.inspection.html
    assert "1 edges were seen blocked" in listed.inspection.html
    assert 'aria-label="probability that the edge is open, over time"' in html
    assert html.count("<title>seen blocked, day 1") == 2
    assert html.count("<title>seen open, day 1") == 1
    assert "p open" in html
    assert "09:00" in html
    assert "in an hour" in html
    assert "tomorrow at this time" in html
    assert "taken for open again from day" in html


def test_a_strip_tells_what_was_known_at_the_moment_of_a_replay(harness: SessionHarness) -> None:
    edge = an_edge(harness)
    harness.do(c.StartRecording(), ticks=3)
    harness.driver.twist = None
    see(harness, edge, 8 * HOUR + 60, present=False)
    harness.wait(10)
    see(harness, edge, 9 * HOUR, present=True)
    harness.do(c.KeepRecording(), ticks=2)
    name = harness.writers[-1].path.name
    shown = harness.do(c.OpenRecording(name, 1e9), c.ChooseQuestion(QuestionName.PRESENCE), c.PointAt(*edge), ticks=4)
    assert shown.mode is Mode.REPLAY
    assert shown.inspection.html.count("<title>seen ") == 2
    first = [number for number, label in links(shown) if label.endswith(" s")][-1]
    earlier = harness.do(c.FollowLink(first), ticks=4)
    assert earlier.inspection.html.count("<title>seen ") == 1
    assert "seen blocked" in earlier.inspection.html


def test_why_it_went_around_is_told_for_a_plan_over_an_edge_that_was_seen_blocked(harness: SessionHarness) -> None:
    graph = harness.state.live_map.graph
    goal = max(graph.nodes)
    harness.do(c.NavigateTo(goal))
    harness.until(lambda snapshot: snapshot.mode is Mode.TELEOP)
    plan = max((each.planned.nodes for each in harness.state.live.timeline.plans), key=len)
    harness.do(c.NavigateTo(plan[0]))
    harness.until(lambda snapshot: snapshot.mode is Mode.TELEOP)
    see(harness, (plan[0], plan[1]), 9 * HOUR, present=False)
    see(harness, (plan[-2], plan[-1]), 9 * HOUR, present=False)
    harness.do(c.NavigateTo(goal))
    harness.until(lambda snapshot: snapshot.mode is Mode.TELEOP)

    shown = harness.do(c.ChooseQuestion(QuestionName.TRIED), ticks=3)

    assert "was open with p = 0." in shown.inspection.html
    assert "Why did it" in shown.inspection.html
    assert palette.EDGE_REMOVED in {stroke.colour for stroke in shown.inspection.answer.overlay.strokes}


def test_the_plan_at_another_time_of_day_is_drawn_with_what_would_be_open(harness: SessionHarness) -> None:
    nodes = sorted(harness.state.live_map.graph.nodes)
    harness.do(c.ChooseQuestion(QuestionName.WHAT_IF), c.SubmitText(f"from {nodes[0]}"), ticks=2)
    shown = harness.do(c.SubmitText(f"goal {nodes[-1]}"), c.SubmitText("belief weight = 2"), ticks=3)
    see(harness, an_edge(harness), 9 * HOUR, present=False)
    shown = harness.do(ticks=15)
    assert "It is day 1, 09:00" in shown.inspection.html

    shown = follow(harness, shown, "at 18:00", ticks=4)

    assert "<b>at 18:00</b>" in shown.inspection.html
    assert "It would be day 1, 18:00, if nobody looked until then." in shown.inspection.html
    assert "would be taken for open, now 0" in shown.inspection.html


def test_what_changed_since_an_hour_ago_names_doors_and_edges(harness: SessionHarness) -> None:
    source, target = an_edge(harness)
    harness.wait(3)
    harness.state.live.emit(WorldChanged(DoorMoved(2, is_open=False), at_s=10 * HOUR))
    see(harness, (source, target), 10 * HOUR + 60, present=False)
    listed = harness.do(c.ChooseQuestion(QuestionName.COMPARE), ticks=15)
    shown = follow(harness, listed, "an hour ago", ticks=4)
    html = shown.inspection.html
    assert "closed here, not there: 1" in html
    assert f"{source} → {target}" in html
    assert "In the world: door 2 closed." in html
    assert "yesterday at this time" not in listed.inspection.html


def test_a_time_may_be_typed_and_one_to_come_is_refused(harness: SessionHarness) -> None:
    see(harness, an_edge(harness), 10 * HOUR, present=False)
    harness.do(c.ChooseQuestion(QuestionName.COMPARE), ticks=2)
    refused = harness.do(c.SubmitText("day 1 23:00"))
    assert refused.message is not None
    assert "It is only day 1, 10:00" in refused.message.text
    shown = harness.do(c.SubmitText("9:00"), ticks=4)
    assert "closed here, not there: 1" in shown.inspection.html
