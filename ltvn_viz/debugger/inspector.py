"""Which tool is on show, what a person pointed at, and what there is to see.

Owns that state and when a tool looks again. Runs in the session's thread.
"""

import re
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, replace
from html import escape

from ltvn_core.errors import LtvnError, OptionError
from ltvn_core.types import NodeId
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.debugger.question import NO_ANSWER, NOTHING_SELECTED, Question, QuestionAnswer, QuestionName, Selection
from ltvn_viz.session.commands import Command

_LINKS = 1000
"""A link is asked for by its number plus so many times the number of the view it was drawn in."""
_REMEMBERED = 100
"""So many views of the tool on show still answer to clicks on them, because a page may be behind, and answers that
change with time are replaced while a person aims.
"""
_LINK = re.compile(r'data-id="link-(\d+)"')


@dataclass(frozen=True, slots=True, eq=False)
class Inspection:
    """What the page shows of the debugger."""

    question: QuestionName = QuestionName.NONE
    about: str = ""
    answer: QuestionAnswer = NO_ANSWER
    serial: int = 0
    """Counts views; part of every link."""
    selection: Selection = NOTHING_SELECTED
    offered: tuple[QuestionName, ...] = (QuestionName.NONE,)

    @property
    def html(self) -> str:
        """The view's markup, with links that carry its number."""
        return _LINK.sub(lambda found: f'data-id="{self.serial * _LINKS + int(found[1])}"', self.answer.html)


NO_INSPECTION = Inspection()


class Inspector:
    """The debugger's state."""

    def __init__(self, tools: Mapping[QuestionName, Question]) -> None:
        """Offer these tools."""
        self._tools = tools
        self.shown = Inspection(offered=(QuestionName.NONE, *(name for name in QuestionName if name in tools)))
        self._key: object = None
        self._case: DebugContext | None = None
        self._drawn: OrderedDict[int, tuple[Command, ...]] = OrderedDict()

    @property
    def is_on(self) -> bool:
        """Tell whether a tool is on show, so that clicks in the scene are meant for it."""
        return self.shown.question is not QuestionName.NONE

    def choose(self, question: QuestionName) -> None:
        """Show a tool, or none."""
        about = self._tools[question].about if question in self._tools else ""
        self.shown = replace(self.shown, question=question, about=about, answer=NO_ANSWER, serial=self.shown.serial + 1)
        self._drawn.clear()
        self._key = None

    def point_at(self, node: NodeId, target: NodeId | None = None) -> None:
        """Select a node, or the edge from it to `target`; the second of two joined nodes selects the edge between."""
        first = self.shown.selection.node
        if target is not None:
            selection = Selection(None, (node, target))
        elif first is not None and self._case is not None and (first, node) in self._case.graph.edges:
            selection = Selection(node, (first, node), first)
        else:
            selection = Selection(node, before=first if first != node else self.shown.selection.before)
        self.shown = replace(self.shown, selection=selection)

    def handle_text(self, text: str) -> Command | None:
        """Hand a person's words to the tool; returns what they ask for, if anything. Raises OptionError, MapError."""
        question = self._tools.get(self.shown.question)
        if question is None or self._case is None:
            raise OptionError("Choose a question first.")
        self._key = None
        return question.handle_text(self._case, text)

    def refresh(self, context: DebugContext) -> None:
        """Let the tool look again if anything changed that it may show."""
        question, self._case = self._tools.get(self.shown.question), context
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

    def mark_stale(self) -> None:
        """Let the tool look again although nothing happened, because it knows more now."""
        self._key = None

    def link(self, number: int) -> Command | None:
        """Return what a link asks for, as it was when it was drawn; None if that was for another question, or too long
        ago.
        """
        serial, place = divmod(number, _LINKS)
        links = self._drawn.get(serial, ())
        return links[place] if place < len(links) else None

    def _remember(self) -> None:
        self._drawn[self.shown.serial] = self.shown.answer.links
        if len(self._drawn) > _REMEMBERED:
            self._drawn.popitem(last=False)
