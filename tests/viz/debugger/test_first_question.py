"""The first answer: what went wrong at the moment, and the next two questions with their arguments."""

from pathlib import Path

import pytest

from ltvn_core.analysis.answer import Paragraph, Pictures
from ltvn_viz.debugger.file_context import FileCase
from ltvn_viz.debugger.file_questions import FileAsk, ask_file
from ltvn_viz.session.inspection import QuestionName
from ltvn_viz.wishes import commands as c
from tests.repository import DEMO_DRIVE, DEMO_FAULT, DEMO_MAP
from tests.viz.debugger.answer_links import answer_of, follow, words
from tests.viz.session_harness import SessionHarness

BUTTONS = 2


@pytest.mark.parametrize("path", [DEMO_FAULT, DEMO_DRIVE, DEMO_MAP])
@pytest.mark.parametrize("share", [0.3, 1.0])
def test_it_has_three_sentences_one_picture_and_two_questions_that_are_answered(path: Path, share: float) -> None:
    case = FileCase(path)
    answer = ask_file(case, FileAsk(question="wrong", at_s=share * case.replay.length_s)).answer
    *told, _ = [block for block in answer.blocks if isinstance(block, Paragraph)]
    pictures = [picture for block in answer.blocks if isinstance(block, Pictures) for picture in block.pictures]
    following = [FileAsk().following(link.to) for link in answer.links() if link.is_button]
    assert len(told) <= 3
    assert len(pictures) <= 1
    assert len(following) == BUTTONS
    for asked in following:
        assert asked is not None
        assert ask_file(case, asked).answer.blocks


def test_a_wrong_arrival_leads_to_the_edge_that_was_driven_and_to_the_plan_without_it() -> None:
    case = FileCase(DEMO_FAULT)
    answer = ask_file(case, FileAsk(question="wrong", query=2)).answer
    edge, without = [FileAsk().following(link.to) for link in answer.links() if link.is_button]
    assert edge is not None
    assert (edge.question, edge.edge) == ("edge", (3081, 2226))
    assert without is not None
    assert (without.question, without.text) == ("what-if", "without 3081->2226")
    assert "instead of" in str(ask_file(case, without).answer)


def test_while_the_robot_drives_it_names_the_edge_and_a_button_asks_about_it(harness: SessionHarness) -> None:
    harness.do(c.Ask(c.Action.PICK, max(harness.state.live_map.graph.nodes)))
    shown = harness.until(lambda now: "drives edge" in words(now))
    assert shown.inspection.question is QuestionName.FIRST
    asked = follow(harness, shown, "Why this edge?")
    assert asked.inspection.question is QuestionName.EDGE
    assert asked.inspection.selection.edge is not None
    assert answer_of(asked).blocks


def test_a_question_that_a_person_asks_is_counted_in_the_recording(harness: SessionHarness) -> None:
    harness.do(c.Ask(c.Action.RECORD), ticks=3)
    edge = c.AskAbout(QuestionName.EDGE, harness.an_edge)
    harness.do(c.Ask(c.Action.QUESTION, QuestionName.TIME), edge, c.Ask(c.Action.QUESTION, "no such question"))
    assert harness.writers[0].asked == ["time", "edge"]
