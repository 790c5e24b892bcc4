"""The Why tab's machinery: questions, also of one's own, links into time, clicks that ask instead of navigate."""

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
from ltvn_viz.session.snapshot import Snapshot
from ltvn_viz.wishes import commands as c
from ltvn_viz.wishes.modes import Mode
from tests.repository import ROOT
from tests.viz.debugger.answer_links import follow, links, words
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
def own(harness: SessionHarness) -> SessionHarness:
    """A session whose debugger knows one question more than ours, and none of ours."""
    harness.state.debugger = Inspector([NodeCountQuestion()], harness.state.worker)
    return harness


def test_a_question_of_ones_own_is_offered_and_answers(own: SessionHarness) -> None:
    shown = own.do(c.Ask(c.Action.QUESTION, "How many nodes?"), ticks=2)
    assert shown.inspection.offered == ("How many nodes?",)
    assert f"{len(own.state.live_map.graph.nodes)} nodes, counted 1 times" in words(shown)
    assert "counted 2 times" in words(follow(own, shown, "count again"))


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
    shown = harness.do(c.Ask(c.Action.QUESTION, "Doubtful edges?"), ticks=2)
    least = min(harness.state.live_map.graph.edges.values(), key=lambda edge: edge.belief.p)
    assert f"p = {least.belief.p:.2f} after {least.attempts} attempts" in words(shown)
    assert shown.inspection.answer.overlay.strokes


def test_a_link_leads_to_a_question_of_ones_own_by_its_word(own: SessionHarness) -> None:
    (asked,) = commands_from_link("tool=node-count", own.state.debugger.words)
    assert own.do(asked).inspection.question == "How many nodes?"


def test_a_question_that_takes_no_text_says_so(own: SessionHarness) -> None:
    own.do(c.Ask(c.Action.QUESTION, "How many nodes?"))
    shown = own.do(c.Ask(c.Action.TELL, "forty?"))
    assert "Nothing can be typed here" in said(shown)


def test_our_questions_keep_the_words_of_links_that_were_sent(tmp_path: Path) -> None:
    words = SessionHarness(tmp_path).state.debugger.words
    sent = "wrong edge blame presence tried time decisions what-if where break compare truth failures coach hand share"
    assert " ".join(words) == sent
    earlier = [words[word] for word in ("blame", "presence", "tried")]
    assert set(earlier) == {words["edge"]}
    assert len(set(words.values())) == len(words) - len(earlier)
    with pytest.raises(OptionError, match="wrong, edge, blame"):
        commands_from_link("tool=explode", words)


def link_numbers(snapshot: Snapshot) -> list[int]:
    return [number for number, _ in links(snapshot)]


def test_without_a_question_nothing_is_asked_and_a_click_navigates(harness: SessionHarness) -> None:
    source, _ = harness.an_edge
    snapshot = harness.do(c.Ask(c.Action.PICK, source))
    assert snapshot.inspection.question is QuestionName.FIRST
    assert snapshot.mode is Mode.NAVIGATING


def test_with_a_question_clicks_on_a_node_and_its_neighbour_ask_about_the_edge_between(harness: SessionHarness) -> None:
    source, target = harness.an_edge
    harness.do(c.Ask(c.Action.QUESTION, QuestionName.EDGE), c.Ask(c.Action.PICK, source))
    snapshot = harness.do(c.Ask(c.Action.PICK, target))
    assert snapshot.mode is Mode.TELEOP
    assert snapshot.inspection.selection.edge == (source, target)
    assert f"{source} → {target}" in words(snapshot)
    assert {source, target} <= snapshot.inspection.answer.overlay.nodes.keys()
    assert snapshot.inspection.answer.overlay.ghosts


def test_a_link_of_a_view_that_was_just_replaced_leads_where_it_said(harness: SessionHarness) -> None:
    source, target = harness.an_edge
    shown = harness.do(c.Ask(c.Action.QUESTION, QuestionName.EDGE), c.PointAt(source, target))
    back = link_numbers(shown)[0]
    turned = harness.do(c.Ask(c.Action.FOLLOW, back))
    again = harness.do(c.Ask(c.Action.FOLLOW, back))
    assert turned.inspection.selection.edge == (target, source)
    assert again.inspection.selection.edge == (target, source)
    assert again.message is None
    assert back not in link_numbers(again)


def test_a_link_of_another_question_says_that_it_is_gone(harness: SessionHarness) -> None:
    source, target = harness.an_edge
    shown = harness.do(c.Ask(c.Action.QUESTION, QuestionName.EDGE), c.PointAt(source, target))
    gone = harness.do(c.Ask(c.Action.QUESTION, QuestionName.TIME), c.Ask(c.Action.FOLLOW, link_numbers(shown)[0]))
    assert gone.inspection.selection.edge == (source, target)
    assert "replaced before your click arrived" in said(gone)
