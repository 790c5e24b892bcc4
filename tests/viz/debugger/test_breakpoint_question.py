"""Stopping where a person asked for it, live and in a recording."""

import re
from pathlib import Path

import pytest

from ltvn_viz.session.inspection import QuestionName
from ltvn_viz.session.snapshot import Snapshot
from ltvn_viz.wishes import commands as c
from ltvn_viz.wishes.commands import Mode
from tests.viz.debugger.answer_links import follow, words
from tests.viz.session_harness import SessionHarness


@pytest.fixture
def harness(tmp_path: Path) -> SessionHarness:
    """A live map of one room with the breakpoints on show."""
    harness = SessionHarness(tmp_path)
    harness.do(c.ChooseQuestion(QuestionName.BREAK))
    return harness


def far_node(harness: SessionHarness) -> int:
    return max(harness.state.live_map.graph.nodes)


def driven(harness: SessionHarness) -> str:
    """Record a drive through the room and return the recording's name."""
    harness.do(c.StartRecording(), c.NavigateTo(far_node(harness)))
    harness.until(lambda snapshot: snapshot.mode is Mode.TELEOP)
    harness.do(c.KeepRecording())
    return harness.writers[-1].path.name


def played(harness: SessionHarness) -> Snapshot:
    harness.do(c.Pause())
    return harness.until(lambda snapshot: snapshot.replay is not None and not snapshot.replay.playing)


def test_a_query_is_held_where_a_breakpoint_is_met_and_the_page_says_which(harness: SessionHarness) -> None:
    goal = far_node(harness)
    harness.do(c.SubmitText(f"node {goal}"), c.NavigateTo(goal))

    held = harness.until(lambda snapshot: snapshot.mode is not Mode.NAVIGATING)

    assert held.mode is Mode.PAUSED
    assert held.message is not None
    assert f"node {goal} is the goal" in held.message.text
    assert "Met once" in words(held)


def test_a_held_query_goes_on_to_its_end_when_it_is_let_go(harness: SessionHarness) -> None:
    goal = far_node(harness)
    harness.do(c.SubmitText(f"node {goal}"), c.NavigateTo(goal))
    harness.until(lambda snapshot: snapshot.mode is Mode.PAUSED)
    harness.do(c.SubmitText("remove all"), c.Pause())

    ended = harness.until(lambda snapshot: snapshot.mode is Mode.TELEOP)

    assert ended.moment.progress.ended is not None


def test_breakpoints_are_taken_away_one_by_one_by_their_links(harness: SessionHarness) -> None:
    both = harness.do(c.SubmitText("prune"), c.SubmitText("margin < 0.2"))

    one = follow(harness, both, "remove")

    assert "prune · remove" in words(both)
    assert "prune · remove" not in words(one)
    assert "margin < 0.2 · remove" in words(one)


def test_what_is_no_breakpoint_is_answered_with_what_is(harness: SessionHarness) -> None:
    shown = harness.do(c.SubmitText("when it <b>goes</b> wrong"))

    assert shown.message is not None
    assert "edge 12->40" in shown.message.text
    assert "goes" not in words(shown)


def test_a_breakpoint_finds_what_the_live_run_met_before_it_was_set(harness: SessionHarness) -> None:
    harness.do(c.NavigateTo(far_node(harness)))
    harness.until(lambda snapshot: snapshot.mode is Mode.TELEOP)

    shown = harness.do(c.SubmitText("distance > -1"))

    assert re.search(r"Met \d+ times", words(shown))
    assert shown.message is None or "Stopped" not in shown.message.text


def test_a_replay_stops_at_each_hit_and_plays_on_from_there(harness: SessionHarness) -> None:
    harness.do(c.OpenRecording(driven(harness)), c.SubmitText("distance > -1"), ticks=2)

    first, second = played(harness), played(harness)

    assert first.replay is not None
    assert second.replay is not None
    assert 0 < first.replay.time_s < second.replay.time_s
    assert first.moment.progress.localised is not None
    assert second.message is not None
    assert "Stopped at" in second.message.text


def test_links_lead_to_the_next_and_to_the_previous_hit_of_a_recording(harness: SessionHarness) -> None:
    shown = harness.do(c.OpenRecording(driven(harness)), c.SubmitText("distance > -1"), ticks=2)

    first = follow(harness, shown, "next")
    second = follow(harness, first, "next")
    back = follow(harness, second, "previous")

    assert first.replay is not None
    assert second.replay is not None
    assert back.replay is not None
    assert back.replay.time_s == first.replay.time_s < second.replay.time_s


def test_an_offer_that_was_taken_is_offered_no_more(harness: SessionHarness) -> None:
    offered = harness.do(ticks=2)

    taken = follow(harness, offered, "p crosses R_p")

    assert words(taken).count("p crosses R_p") == 1
    assert "p crosses R_p · remove" in words(taken)
