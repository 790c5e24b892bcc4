"""Advice while somebody drives."""

from pathlib import Path

from ltvn_core.graph.deltas import Cause, EdgePruned
from ltvn_viz import commands as c
from ltvn_viz.why.tool import ToolName
from tests.viz.theatre import Theatre


def test_the_coach_says_where_to_drive_and_a_ghost_stands_there(tmp_path: Path) -> None:
    shown = Theatre(tmp_path).do(c.ChooseTool(ToolName.COACH), ticks=4)

    assert "in one piece" in shown.inspection.html
    assert "% new" in shown.inspection.html
    assert len(shown.inspection.view.overlay.ghosts) == 1


def test_a_map_that_falls_apart_is_to_be_joined_first(tmp_path: Path) -> None:
    theatre = Theatre(tmp_path)
    graph = theatre.stage.mapping.graph
    middle = sorted(graph.nodes)[len(graph.nodes) // 2]
    across = [key for key in graph.edges if (key[0] < middle) != (key[1] < middle)]
    theatre.do(c.ChangeMap(tuple(EdgePruned(*key, Cause.HAND) for key in across)), ticks=2)

    shown = theatre.do(c.ChooseTool(ToolName.COACH), ticks=4)

    assert "3 pieces" in shown.inspection.html
    assert "so that they join" in shown.inspection.html
    assert shown.inspection.view.overlay.nodes


def test_in_a_recording_the_coach_says_why_it_is_silent(tmp_path: Path) -> None:
    theatre = Theatre(tmp_path)
    theatre.do(c.StartRecording(), c.KeepRecording())

    shown = theatre.do(c.OpenRecording(theatre.tapes[-1].path.name), c.ChooseTool(ToolName.COACH), ticks=3)

    assert "The coach helps while one drives" in shown.inspection.html
