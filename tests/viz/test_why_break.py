"""Stopping where a person asked for it, live and in a recording."""

from pathlib import Path

import pytest

from ltvn_viz import commands as c
from ltvn_viz.modes import Mode
from ltvn_viz.snapshot import Snapshot
from ltvn_viz.why.tool import ToolName
from tests.viz.theatre import Theatre
from tests.viz.why_links import follow


@pytest.fixture
def theatre(tmp_path: Path) -> Theatre:
    """A live map of one room with the breakpoints on show."""
    theatre = Theatre(tmp_path)
    theatre.do(c.ChooseTool(ToolName.BREAK))
    return theatre


def far_node(theatre: Theatre) -> int:
    return max(theatre.stage.mapping.graph.nodes)


def driven(theatre: Theatre) -> str:
    """Record a drive through the room and return the recording's name."""
    theatre.do(c.StartRecording(), c.NavigateTo(far_node(theatre)))
    theatre.until(lambda snapshot: snapshot.mode is Mode.TELEOP)
    theatre.do(c.KeepRecording())
    return theatre.tapes[-1].path.name


def played(theatre: Theatre) -> Snapshot:
    theatre.do(c.Pause())
    return theatre.until(lambda snapshot: snapshot.replay is not None and not snapshot.replay.playing)


def test_a_task_is_held_where_a_breakpoint_is_met_and_the_page_says_which(theatre: Theatre) -> None:
    goal = far_node(theatre)
    theatre.do(c.Tell(f"node {goal}"), c.NavigateTo(goal))

    held = theatre.until(lambda snapshot: snapshot.mode is not Mode.NAVIGATING)

    assert held.mode is Mode.PAUSED
    assert held.message is not None
    assert f"node {goal} is the goal" in held.message.text
    assert "Met <b>once</b>" in held.inspection.html


def test_a_held_task_goes_on_to_its_end_when_it_is_let_go(theatre: Theatre) -> None:
    goal = far_node(theatre)
    theatre.do(c.Tell(f"node {goal}"), c.NavigateTo(goal))
    theatre.until(lambda snapshot: snapshot.mode is Mode.PAUSED)
    theatre.do(c.Tell("remove all"), c.Pause())

    ended = theatre.until(lambda snapshot: snapshot.mode is Mode.TELEOP)

    assert ended.moment.progress.ended is not None


def test_breakpoints_are_taken_away_one_by_one_by_their_links(theatre: Theatre) -> None:
    both = theatre.do(c.Tell("prune"), c.Tell("margin < 0.2"))

    one = follow(theatre, both, "remove")

    assert "<b>prune</b>" in both.inspection.html
    assert "<b>prune</b>" not in one.inspection.html
    assert "margin &lt; 0.2" in one.inspection.html


def test_what_is_no_breakpoint_is_answered_with_what_is(theatre: Theatre) -> None:
    shown = theatre.do(c.Tell("when it <b>goes</b> wrong"))

    assert shown.message is not None
    assert "edge 12->40" in shown.message.text
    assert "goes" not in shown.inspection.html


def test_a_breakpoint_finds_what_the_live_run_met_before_it_was_set(theatre: Theatre) -> None:
    theatre.do(c.NavigateTo(far_node(theatre)))
    theatre.until(lambda snapshot: snapshot.mode is Mode.TELEOP)

    shown = theatre.do(c.Tell("distance > -1"))

    assert "times</b>" in shown.inspection.html
    assert shown.message is None or "Stopped" not in shown.message.text


def test_a_replay_stops_at_each_hit_and_plays_on_from_there(theatre: Theatre) -> None:
    theatre.do(c.OpenRecording(driven(theatre)), c.Tell("distance > -1"), ticks=2)

    first, second = played(theatre), played(theatre)

    assert first.replay is not None
    assert second.replay is not None
    assert 0 < first.replay.time_s < second.replay.time_s
    assert first.moment.progress.localised is not None
    assert second.message is not None
    assert "Stopped at" in second.message.text


def test_links_lead_to_the_next_and_to_the_previous_hit_of_a_recording(theatre: Theatre) -> None:
    shown = theatre.do(c.OpenRecording(driven(theatre)), c.Tell("distance > -1"), ticks=2)

    first = follow(theatre, shown, "next")
    second = follow(theatre, first, "next")
    back = follow(theatre, second, "previous")

    assert first.replay is not None
    assert second.replay is not None
    assert back.replay is not None
    assert back.replay.time_s == first.replay.time_s < second.replay.time_s
