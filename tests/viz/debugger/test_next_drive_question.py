"""Advice while somebody drives."""

from pathlib import Path

from ltvn_core.graph.deltas import Cause, EdgePruned
from ltvn_viz.session.inspection import QuestionName
from ltvn_viz.wishes import commands as c
from tests.viz.debugger.answer_links import words
from tests.viz.session_harness import SessionHarness


def test_the_coach_says_where_to_drive_and_a_ghost_stands_there(tmp_path: Path) -> None:
    shown = SessionHarness(tmp_path).do(c.Ask(c.Action.QUESTION, QuestionName.COACH), ticks=4)
    assert "in one piece" in words(shown)
    assert "% new" in words(shown)
    assert len(shown.inspection.answer.overlay.ghosts) == 1


def test_a_map_that_falls_apart_is_to_be_joined_first(harness: SessionHarness) -> None:
    graph = harness.state.live_map.graph
    middle = sorted(graph.nodes)[len(graph.nodes) // 2]
    across = [key for key in graph.edges if (key[0] < middle) != (key[1] < middle)]
    harness.do(c.EditMap(tuple(EdgePruned(*key, Cause.HAND) for key in across)), ticks=2)
    shown = harness.do(c.Ask(c.Action.QUESTION, QuestionName.COACH), ticks=4)
    assert "3 pieces" in words(shown)
    assert "pieces join" in words(shown)
    assert shown.inspection.answer.overlay.nodes


def test_in_a_recording_the_coach_says_why_it_is_silent(harness: SessionHarness) -> None:
    harness.do(c.Ask(c.Action.RECORD), c.Ask(c.Action.KEEP))
    shown = harness.do(
        c.OpenRecording(harness.writers[-1].path.name), c.Ask(c.Action.QUESTION, QuestionName.COACH), ticks=3
    )
    assert "advice is for driving" in words(shown)
