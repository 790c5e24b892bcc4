"""A question of one's own is a class and a line: the page lists it, and links lead to it."""

from importlib.metadata import EntryPoint
from pathlib import Path
from runpy import run_path

import pytest

from ltvn_core.errors import OptionError
from ltvn_core.plugins import QUESTIONS, find_plugins
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.debugger.inspector import Inspector
from ltvn_viz.debugger.question import AnswerBuilder, Question, request_link
from ltvn_viz.debugger.question_registry import installed_questions
from ltvn_viz.session.inspection import QuestionAnswer, QuestionName, Selection
from ltvn_viz.session.share_links import commands_from_link
from ltvn_viz.wishes import commands as c
from tests.repository import ROOT
from tests.viz.debugger.answer_links import follow, words
from tests.viz.session_harness import SessionHarness, said


class CountNodes(c.QuestionRequest):
    """Count once more."""


class NodeCountQuestion(Question[CountNodes]):
    """Says how many nodes the map has, and how often it was asked to count."""

    name = "How many nodes?"
    word = "node-count"
    about = "The size of the map."

    def __init__(self) -> None:
        self.counts = 1

    def answer(self, context: DebugContext, selection: Selection) -> QuestionAnswer:
        builder = AnswerBuilder()
        builder.add_line(f"{len(context.graph.nodes)} nodes, counted {self.counts} times")
        builder.add_line(request_link("count again", CountNodes()))
        return builder.build()

    def handle_request(self, context: DebugContext, request: CountNodes) -> None:
        self.counts += 1


@pytest.fixture
def harness(harness: SessionHarness) -> SessionHarness:
    """A session whose debugger knows one question more than ours, and none of ours."""
    harness.state.debugger = Inspector([NodeCountQuestion()], harness.state.worker)
    return harness


def test_a_question_of_ones_own_is_offered_and_answers(harness: SessionHarness) -> None:
    shown = harness.do(c.ChooseQuestion("How many nodes?"), ticks=2)
    assert shown.inspection.offered == (QuestionName.NONE, "How many nodes?")
    assert f"{len(harness.state.live_map.graph.nodes)} nodes, counted 1 times" in words(shown)
    assert "counted 2 times" in words(follow(harness, shown, "count again"))


def test_installed_questions_follow_and_a_broken_one_is_named(caplog: pytest.LogCaptureFixture) -> None:
    here = f"{__name__}:NodeCountQuestion"
    entries = [
        EntryPoint(name="nodes", value=here, group=QUESTIONS.name),
        EntryPoint(name="gone", value="no.such.module:Question", group=QUESTIONS.name),
        EntryPoint(name="text", value=f"{__name__}:str", group=QUESTIONS.name),
    ]
    (question,) = installed_questions(find_plugins(QUESTIONS, entries=entries))
    assert question.word == "node-count"
    assert "The question gone cannot be loaded (ModuleNotFoundError" in caplog.text


def test_the_example_of_a_question_shows_the_edges_that_are_believed_in_least(tmp_path: Path) -> None:
    harness = SessionHarness(tmp_path)
    example = run_path(str(ROOT / "examples" / "08_add_a_debugger_question.py"))["DoubtfulEdgesQuestion"]
    harness.state.debugger = Inspector([example()], harness.state.worker)
    shown = harness.do(c.ChooseQuestion("Doubtful edges?"), ticks=2)
    least = min(harness.state.live_map.graph.edges.values(), key=lambda edge: edge.belief.p)
    assert f"p = {least.belief.p:.2f} after {least.attempts} attempts" in words(shown)
    assert shown.inspection.answer.overlay.strokes


def test_a_link_leads_to_a_question_of_ones_own_by_its_word(harness: SessionHarness) -> None:
    (asked,) = commands_from_link("tool=node-count", harness.state.debugger.words)
    assert harness.do(asked).inspection.question == "How many nodes?"


def test_a_question_that_takes_no_text_says_so(harness: SessionHarness) -> None:
    harness.do(c.ChooseQuestion("How many nodes?"))
    shown = harness.do(c.SubmitText("forty?"))
    assert "Nothing can be typed here" in said(shown)


def test_our_questions_keep_the_words_of_links_that_were_sent(tmp_path: Path) -> None:
    words = SessionHarness(tmp_path).state.debugger.words
    sent = "edge blame presence tried time decisions what-if where break compare truth failures coach hand share"
    assert " ".join(words) == sent
    earlier = [words[word] for word in ("blame", "presence", "tried")]
    assert set(earlier) == {words["edge"]}
    assert len(set(words.values())) == len(words) - len(earlier)
    with pytest.raises(OptionError, match="edge, blame"):
        commands_from_link("tool=explode", words)
