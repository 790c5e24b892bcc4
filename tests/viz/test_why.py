"""The Why tab's machinery: questions, links into time, clicks that ask instead of navigate."""

import re
from pathlib import Path

import pytest

from ltvn_viz import commands as c
from ltvn_viz.modes import Mode
from ltvn_viz.snapshot import Snapshot
from ltvn_viz.why.tool import ToolName
from tests.viz.theatre import Theatre


@pytest.fixture
def theatre(tmp_path: Path) -> Theatre:
    """A live map of one room, and an edge to ask about."""
    return Theatre(tmp_path)


def an_edge(theatre: Theatre) -> tuple[int, int]:
    return next(iter(theatre.stage.mapping.graph.edges))


def link_numbers(snapshot: Snapshot) -> list[int]:
    return [
        int(number) for number in re.findall(r'data-ltvn-action="follow" data-id="(\d+)"', snapshot.inspection.html)
    ]


def test_without_a_question_nothing_is_asked_and_a_click_navigates(theatre: Theatre) -> None:
    source, _ = an_edge(theatre)

    snapshot = theatre.do(c.Pick(source))

    assert snapshot.inspection.tool is ToolName.NONE
    assert snapshot.inspection.html == ""
    assert snapshot.mode is Mode.NAVIGATING


def test_with_a_question_clicks_on_a_node_and_its_neighbour_ask_about_the_edge_between(theatre: Theatre) -> None:
    source, target = an_edge(theatre)
    theatre.do(c.ChooseTool(ToolName.EDGE), c.Pick(source))

    snapshot = theatre.do(c.Pick(target))

    assert snapshot.mode is Mode.TELEOP
    assert snapshot.inspection.selection.edge == (source, target)
    assert f"{source} → {target}" in snapshot.inspection.html
    assert {source, target} <= snapshot.inspection.view.overlay.nodes.keys()
    assert snapshot.inspection.view.overlay.ghosts


def test_a_link_of_a_view_that_was_just_replaced_leads_where_it_said(theatre: Theatre) -> None:
    source, target = an_edge(theatre)
    shown = theatre.do(c.ChooseTool(ToolName.EDGE), c.PointAt(source, target))
    back = link_numbers(shown)[0]

    turned = theatre.do(c.Follow(back))
    again = theatre.do(c.Follow(back))

    assert turned.inspection.selection.edge == (target, source)
    assert again.inspection.selection.edge == (target, source)
    assert again.message is None
    assert back not in link_numbers(again)


def test_a_link_of_another_question_says_that_it_is_gone(theatre: Theatre) -> None:
    source, target = an_edge(theatre)
    shown = theatre.do(c.ChooseTool(ToolName.EDGE), c.PointAt(source, target))

    gone = theatre.do(c.ChooseTool(ToolName.BLAME), c.Follow(link_numbers(shown)[0]))

    assert gone.inspection.selection.edge == (source, target)
    assert gone.message is not None
    assert "replaced before your click arrived" in gone.message.text


def test_the_live_run_can_be_looked_back_at_and_come_back_from(theatre: Theatre) -> None:
    theatre.do(c.Pick(max(theatre.stage.mapping.graph.nodes)))
    theatre.until(lambda snapshot: snapshot.mode is Mode.TELEOP)
    end = theatre.now.moment.stamp

    before = theatre.do(c.Seek(0.2))
    now = theatre.do(c.Seek(1e6))

    assert before.moment.stamp < end
    assert now.moment.stamp >= end


def test_words_that_no_tool_asked_for_are_answered_with_what_to_do(theatre: Theatre) -> None:
    snapshot = theatre.do(c.Tell("hello"))

    assert snapshot.message is not None
    assert "Choose a question first" in snapshot.message.text
