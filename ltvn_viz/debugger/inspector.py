"""Which question is on show, what a person pointed at, and what there is to see.

Owns that state and when a question looks again. Implements `ltvn_viz.session.app_state.Debugger`; runs in the session's
thread.
"""

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import replace
from html import escape
from typing import Any

from ltvn_core.errors import LtvnError, OptionError
from ltvn_core.types import NodeId
from ltvn_viz.debugger.background_cache import BackgroundCache
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.debugger.context_builder import DebugContextBuilder
from ltvn_viz.debugger.question import Question
from ltvn_viz.session.app_state import AppState
from ltvn_viz.session.commands import Command, QuestionRequest
from ltvn_viz.session.inspection import (
    LINKS_PER_VIEW,
    NO_ANSWER,
    Inspection,
    QuestionAnswer,
    QuestionName,
    Selection,
)
from ltvn_viz.session.worker import JobQueue
from ltvn_viz.timeline.run_moment import RunMoment

_REMEMBERED = 100
"""So many views of the tool on show still answer to clicks on them, because a page may be behind, and answers that
change with time are replaced while a person aims.
"""


class Inspector:
    """The debugger's state."""

    def __init__(self, questions: Sequence[Question[Any]], worker: JobQueue, *, first_serial: int = 0) -> None:
        """Offer these questions in this order, and let them compute slow answers in `worker`.

        Views are counted from `first_serial`, so that the links of several debuggers are not taken for each other's.
        """
        self._questions: dict[str, Question[Any]] = {question.name: question for question in questions}
        self.words = {question.word: question.name for question in questions}
        self._in_background = BackgroundCache(worker, self.mark_stale)
        self._contexts = DebugContextBuilder(self._in_background)
        self.names = (QuestionName.NONE, *self._questions)
        self.shown = Inspection(offered=(QuestionName.NONE,), serial=first_serial)
        self._key: object = None
        self._context: DebugContext | None = None
        self._drawn: OrderedDict[int, tuple[Command, ...]] = OrderedDict()

    @property
    def is_on(self) -> bool:
        """Tell whether a tool is on show, so that clicks in the scene are meant for it."""
        return self.shown.question != QuestionName.NONE

    def choose(self, question: str) -> None:
        """Show a tool, or none."""
        chosen = self._questions.get(question)
        about, verb = ("", "") if chosen is None else (chosen.about, chosen.verb)
        self.shown = replace(
            self.shown, question=question, about=about, verb=verb, answer=NO_ANSWER, serial=self.shown.serial + 1
        )
        self._in_background.leave()
        self._drawn.clear()
        self._key = None

    def point_at(self, node: NodeId, target: NodeId | None = None) -> None:
        """Select a node, or the edge from it to `target`; the second of two joined nodes selects the edge between."""
        first = self.shown.selection.node
        if target is not None:
            selection = Selection(None, (node, target))
        elif first is not None and self._context is not None and (first, node) in self._context.graph.edges:
            selection = Selection(node, (first, node), first)
        else:
            selection = Selection(node, before=first if first != node else self.shown.selection.before)
        self.shown = replace(self.shown, selection=selection)

    def handle_text(self, text: str) -> Command | None:
        """Hand a person's words to the tool; returns what they ask for, if anything. Raises OptionError, MapError."""
        question, context = self._asked()
        return question.handle_text(context, text)

    def handle_request(self, request: QuestionRequest) -> Command | None:
        """Hand what a link asks for to its question; returns what that asks of the session. Raises LtvnError."""
        question, context = self._asked()
        return question.handle_request(context, request)

    def _asked(self) -> tuple[Question[Any], DebugContext]:
        question = self._questions.get(self.shown.question)
        if question is None or self._context is None:
            raise OptionError("Choose a question first.")
        self._key = None
        return question, self._context

    def context(self, state: AppState, moment: RunMoment) -> DebugContext:
        """Return what the questions may look at when the page shows `moment`."""
        return self._contexts.build(state, moment)

    def refresh(self, state: AppState, moment: RunMoment) -> None:
        """Let the question on show look again if anything changed that it may show."""
        question = self._questions.get(self.shown.question)
        self._context = context = self.context(state, moment)
        self._offer(context)
        run = context.name, context.timeline, context.known_events
        key = self.shown.question, self.shown.selection, run, context.step, context.viewpoint
        if question is None or key == self._key:
            return
        self._key = key
        try:
            answer = question.answer(context, self.shown.selection)
        except LtvnError as error:
            answer = QuestionAnswer(f'<div class="lt">{escape(str(error))}</div>')
        if answer != self.shown.answer:
            self.shown = replace(self.shown, answer=answer, serial=self.shown.serial + 1)
            self._remember()

    def _offer(self, context: DebugContext) -> None:
        """Offer what can be answered in this run, and the question on show in any case."""
        questions = self._questions.values()
        names = [each.name for each in questions if each.is_offered(context) or each.name == self.shown.question]
        offered = (QuestionName.NONE, *names)
        if offered != self.shown.offered:
            self.shown = replace(self.shown, offered=offered)

    def notify(self, text: str) -> None:
        """Tell the page that asks something."""
        self.shown = replace(self.shown, notice=text, notice_number=self.shown.notice_number + 1)

    def mark_stale(self) -> None:
        """Let the tool look again although nothing happened, because it knows more now."""
        self._key = None

    def take_in_all_events(self) -> None:
        """Let answers count what happened just now too, because a person waits to see what was changed."""
        self._contexts.count_now()

    def link(self, number: int) -> Command | None:
        """Return what a link asks for, as it was when it was drawn; None if that was for another question, or too long
        ago.
        """
        serial, place = divmod(number, LINKS_PER_VIEW)
        links = self._drawn.get(serial, ())
        return links[place] if place < len(links) else None

    def _remember(self) -> None:
        self._drawn[self.shown.serial] = self.shown.answer.links
        if len(self._drawn) > _REMEMBERED:
            self._drawn.popitem(last=False)
