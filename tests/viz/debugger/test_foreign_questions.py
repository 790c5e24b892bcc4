"""A question of another package that is broken is named, and takes neither the page nor the other questions along."""

from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from ltvn_core.analysis.answer_text import answer_text
from ltvn_core.plugins import QUESTIONS, Plugin, find_plugins
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.debugger.edge_question import EdgeQuestion
from ltvn_viz.debugger.inspector import Inspector
from ltvn_viz.debugger.question import AnswerBuilder, Question
from ltvn_viz.debugger.question_registry import installed_questions
from ltvn_viz.session.inspection import QuestionAnswer, Selection
from ltvn_viz.wishes import commands as c
from tests.core.plugin_packages import install, ltvn
from tests.repository import DEMO_FAULT
from tests.viz.session_harness import SessionHarness


class Sound(Question):
    name = "Sound?"
    word = "sound"
    about = "It works."

    def answer(self, context: DebugContext, selection: Selection) -> QuestionAnswer:
        builder = AnswerBuilder()
        builder.add_line("all is well")
        return builder.build()


class Wordless(Sound):
    word = None


class Spaced(Sound):
    word = "two words"


class Raising(Sound):
    @property
    def about(self) -> str:
        raise ZeroDivisionError("no about")


class Clashing(Sound):
    name = "Another edge?"
    word = "edge"


class Unmade(Sound):
    def __init__(self) -> None:
        raise SystemExit(3)


class Dividing(Sound):
    name = "Dividing?"
    word = "dividing"

    def answer(self, context: DebugContext, selection: Selection) -> QuestionAnswer:
        raise ZeroDivisionError("one by none")


class Texting(Sound):
    name = "Texting?"
    word = "texting"

    def answer(self, context: DebugContext, selection: Selection) -> QuestionAnswer:
        return "a text"  # type: ignore[return-value]


class Undrawable(Sound):
    name = "Undrawable?"
    word = "undrawable"

    def answer(self, context: DebugContext, selection: Selection) -> QuestionAnswer:
        builder = AnswerBuilder()
        builder.add_line(3)  # type: ignore[arg-type]
        return builder.build()


class Unoffered(Sound):
    name = "Unoffered?"
    word = "unoffered"

    def is_offered(self, context: DebugContext) -> bool:
        raise LookupError("cannot offer")


def plugins(*names: str) -> dict[str, Plugin]:
    entries = [EntryPoint(name, f"{__name__}:{name}", QUESTIONS.name) for name in names]
    return find_plugins(QUESTIONS, entries=entries)


@pytest.mark.parametrize("name", ["Wordless", "Spaced", "Raising", "Clashing", "Unmade"])
def test_a_question_with_a_wrong_attribute_is_named_and_left_out(name: str, caplog: pytest.LogCaptureFixture) -> None:
    found = installed_questions(plugins(name, "Sound"), [EdgeQuestion()])
    assert [question.word for question in found] == ["sound"]
    (line,) = caplog.messages
    assert name in line


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("Dividing", "ZeroDivisionError: one by none"),
        ("Texting", "answers with str"),
        ("Undrawable", "question Undrawable"),
        ("Unoffered", "LookupError: cannot offer"),
    ],
)
def test_what_goes_wrong_in_a_question_is_its_answer(harness: SessionHarness, name: str, said: str) -> None:
    asked = [*installed_questions(plugins(name, "Sound"))]
    harness.state.debugger = Inspector(asked, harness.state.worker)
    shown = harness.do(c.Ask(c.Action.QUESTION, f"{name}?"), ticks=2)
    assert said in answer_text(shown.inspection.answer.answer)
    shown = harness.do(c.Ask(c.Action.QUESTION, "Sound?"), ticks=2)
    assert "all is well" in answer_text(shown.inspection.answer.answer)


def test_the_terminal_goes_on_with_a_broken_question_beside_one_that_fails(tmp_path: Path) -> None:
    source = (
        "from tests.viz.debugger.test_foreign_questions import Dividing, Wordless\n"
        "Dividing.__module__ = Wordless.__module__ = __name__\n"
    )
    entries = f"[{QUESTIONS.name}]\nwordless = odd_questions:Wordless\ndividing = odd_questions:Dividing\n"
    install(tmp_path, "odd-questions", entries, source=source)
    asked = ltvn(tmp_path, "why", str(DEMO_FAULT), "--ask", "dividing")
    assert asked.returncode == 0
    (line,) = asked.stderr.strip().splitlines()
    assert "wordless of the package odd-questions" in line
    assert "ZeroDivisionError: one by none" in asked.stdout
