"""Questions about a recording or a map without a page: asked by text and numbers, and answered completely.

Owns the arguments of a question and their validation, waiting for slow answers, and the conversion of a link to a
question. Nothing is cached between questions, and no file is written.
"""

import math
import shlex
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from ltvn_core.analysis.answer import Answer, Paragraph
from ltvn_core.analysis.what_if_changes import format_what_if_change
from ltvn_core.errors import OptionError
from ltvn_core.garbage_collection import garbage_collection_paused
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.terminal_text import which_name
from ltvn_core.types import NodeId
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.debugger.file_context import FileCase, JobsAtOnce
from ltvn_viz.debugger.question import Question
from ltvn_viz.debugger.question_registry import all_questions
from ltvn_viz.debugger.what_if_question import ImagineChange
from ltvn_viz.session.inspection import QuestionName, Selection
from ltvn_viz.wishes.commands import Action, Ask, AskAbout, AskQuestion, PointAt, Seek

__all__ = ["FileAsk", "FileCase", "ask_file"]

LONGEST_S = 300.0
"""Time limit for an answer, in seconds."""
LONGEST_TEXT = 1000
"""Maximum number of characters of the text for a question."""


@dataclass(frozen=True, kw_only=True)
class FileAsk:
    """A question about a file; without the name of a question, the selection determines which question it is."""

    question: str = ""
    """Word of the question."""
    at_s: float | None = None
    """Time in seconds after the beginning; by default the end of the query or of the file."""
    edge: EdgeKey | None = None
    node: NodeId | None = None
    query: int | None = None
    """Number of a navigation task."""
    text: str = ""
    """Text typed into the question, such as `without 12->40`."""

    @property
    def word(self) -> str:
        """Word of the question, given or derived from the selection; empty for none."""
        if self.question:
            return self.question
        if self.edge is not None or self.node is not None:
            return QuestionName.EDGE.word
        return QuestionName.FAILURES.word if self.query is not None else ""

    @property
    def about(self) -> dict[str, Any]:
        """The selection and the text, for a program."""
        about = {"edge": self.edge, "node": self.node, "query": self.query, "text": self.text or None}
        return {name: value for name, value in about.items() if value is not None}

    @property
    def selection(self) -> Selection:
        """The selection, in the page's form."""
        return Selection(node=self.node, edge=self.edge, query=self.query)

    def arguments(self) -> dict[str, Any]:
        """Return the question as names and values, without the empty ones."""
        at = {} if self.at_s is None else {"at_s": _milliseconds(self.at_s)}
        return {"question": self.word, **at, **self.about}

    def command_line(self, file: str) -> str:
        """Return the command line for this question."""
        words = ["ltvn", "why", file, "--ask", self.word]
        words += [] if self.at_s is None else ["--at", f"{_milliseconds(self.at_s):.10g}"]
        words += [] if self.edge is None else ["--edge", *map(str, self.edge)]
        words += [] if self.node is None else ["--node", str(self.node)]
        words += [] if self.query is None else ["--query", str(self.query)]
        words += ["--text", self.text] if self.text else []
        return shlex.join(words)

    def following(self, command: object) -> "FileAsk | None":
        """Return the question that a link asks; None if only the page can follow the link."""
        match command:
            case Seek(time_s=time_s):
                return replace(self, at_s=time_s, query=None)
            case PointAt(node=node, target=None):
                return replace(self, node=node, edge=None, text="")
            case PointAt(node=node, target=target):
                return replace(self, edge=(node, target), node=None, text="")
            case Ask(Action.QUESTION, str() as name) if name in set(QuestionName):
                return replace(self, question=QuestionName(name).word, text="")
            case AskQuestion(request=ImagineChange(change)):
                return replace(self, text=format_what_if_change(change))
            case AskAbout(question, edge, request, at_s):
                text = format_what_if_change(request.change) if isinstance(request, ImagineChange) else ""
                at_s = self.at_s if at_s is None else at_s
                return FileAsk(question=QuestionName(question).word, at_s=at_s, edge=edge, text=text)
            case _:
                return None


@dataclass(frozen=True, kw_only=True)
class FileAnswer:
    """An answer and its complete question."""

    asked: FileAsk
    """The question, with default values filled in."""
    answer: Answer


def _milliseconds(seconds: float) -> float:
    """Round up to milliseconds, so that the event that a link leads to has just happened."""
    return math.ceil(seconds * 1000) / 1000


def offered_questions(case: FileCase) -> dict[str, str]:
    """Return the questions that can be answered for this file, by their words, each with its description."""
    context = case.context(case.replay.length_s, JobsAtOnce())
    return {word: question.about for word, question in _questions().items() if question.is_offered(context)}


def ask_file(case: FileCase, asked: FileAsk, *, longest_s: float = LONGEST_S) -> FileAnswer:
    """Answer a question about a file, and wait for slow answers until a deadline.

    Raises OptionError for invalid questions, with valid ones, and the errors of the question for invalid text.
    """
    questions = _questions()
    earlier = {word: each.word for each in questions.values() for word in each.earlier_words}
    asked = replace(asked, question=earlier.get(asked.word, asked.word))
    if not asked.word:
        raise OptionError(f"Which question? Choose one of: {', '.join(questions)}.")
    if asked.word not in questions:
        raise OptionError(f"No question has the word {asked.word!r:.60}. {which_name(asked.word, questions)}.")
    _check(case, asked)
    jobs = JobsAtOnce(longest_s)
    context = case.context(_time(case, asked), jobs)
    question = questions[asked.word]
    if not question.is_offered(context):
        offered = [word for word, each in questions.items() if each.is_offered(context)]
        raise OptionError(
            f"“{question.name}” ({asked.word}) cannot be answered in {case.path.name}; these can: {', '.join(offered)}."
        )
    with garbage_collection_paused():
        answer = _answered(question, context, asked, jobs)
    return FileAnswer(asked=replace(asked, at_s=context.moment.stamp - context.start_s), answer=answer)


def _answered(question: Question[Any], context: DebugContext, asked: FileAsk, jobs: JobsAtOnce) -> Answer:
    """Return the complete answer to a question; say what could be typed if nothing was."""
    if asked.text:
        question.answer(context, asked.selection)  # A question takes a text once it was asked.
        if question.handle_text(context, asked.text) is not None:
            raise OptionError(f"{asked.text!r:.60} would change a live map; files are only read.")
    found = jobs.complete(lambda: question.answer(context, asked.selection))
    if found.input_hint and not asked.about:
        return Answer((*found.answer.blocks, Paragraph((f"--text takes: {found.input_hint}",))))
    return found.answer


def _questions() -> Mapping[str, Question[Any]]:
    return {question.word: question for question in all_questions(None)}


def _check(case: FileCase, asked: FileAsk) -> None:
    if asked.edge is not None and asked.node is not None:
        raise OptionError("Point at an edge or at a node, not at both.")
    if len(asked.text) > LONGEST_TEXT:
        raise OptionError(f"A text has at most {LONGEST_TEXT} letters, this one has {len(asked.text)}.")
    for node in (*(asked.edge or ()), *(() if asked.node is None else (asked.node,))):
        if not case.timeline.changes_of_node(node):
            raise OptionError(f"{case.path.name} has no node {node!s:.20}{_known_nodes(case)}.")
    if asked.edge is not None and asked.edge[0] == asked.edge[1]:
        raise OptionError(f"An edge joins two different nodes, not {asked.edge[0]} with itself.")


def _known_nodes(case: FileCase) -> str:
    nodes = sorted(case.timeline.graph_at().nodes)
    if not nodes:
        return "; it contains no map"
    near = ", ".join(map(str, nodes[:3]))
    return f"; its {len(nodes)} nodes are {near} … {nodes[-1]}" if len(nodes) > 3 else f"; its nodes are {near}"


def _time(case: FileCase, asked: FileAsk) -> float:
    """Return the time in seconds after the beginning: the given time, the end of the query, or the end of the file."""
    known = {query.id: query for query in case.timeline.queries}
    if asked.query is not None and asked.query not in known:
        there = f"has the queries {min(known)} to {max(known)}" if known else "has no queries"
        raise OptionError(f"{case.path.name} has no query {asked.query!s:.20}; it {there}.")
    query = None if asked.query is None else known[asked.query]
    if asked.at_s is not None:
        return asked.at_s
    if query is None or query.end is None:
        return case.replay.length_s
    return min(query.end.stamp - case.timeline.start_s, case.replay.length_s)
