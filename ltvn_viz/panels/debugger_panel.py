"""The “Why” tab: a row of questions, and the answer to one of them."""

from collections.abc import Callable, Mapping
from html import escape

import viser

from ltvn_viz.panels.html_widgets import HtmlBlock
from ltvn_viz.session.inspection import Inspection, QuestionName
from ltvn_viz.session.snapshot import Snapshot
from ltvn_viz.wishes.commands import Ask
from ltvn_viz.wishes.wish_table import Action

_ROW: Mapping[str, str] = {
    QuestionName.FIRST: "What went wrong?",
    QuestionName.WHERE: "Where?",
    QuestionName.DECISIONS: "Why this way?",
    QuestionName.EDGE: "Why this edge?",
    QuestionName.WHAT_IF: "What if?",
    QuestionName.COMPARE: "What changed?",
}
"""What a person wants to know, by the name of the question that answers it; all other questions are under “More”."""


class DebuggerPanel:
    """The questions as buttons, the answer, and a text field for questions that need input."""

    def __init__(self, gui: viser.GuiApi, send: Callable[[Ask], None]) -> None:
        """Add the controls to the open tab; `send` takes wishes and returns at once."""
        self._questions = HtmlBlock(gui)
        self._view = HtmlBlock(gui)
        self._field = gui.add_text("What to ask", "", visible=False)
        self._tell = gui.add_button("Ask", visible=False)

        @self._tell.on_click
        async def _(_: viser.GuiEvent) -> None:
            send(Ask(Action.TELL, self._field.value))

    def show(self, snapshot: Snapshot) -> None:
        """Show the question's answer."""
        inspection = snapshot.inspection
        self._questions.show(_questions(inspection))
        self._view.show(inspection.html)
        input_hint = inspection.answer.input_hint
        self._field.visible = self._tell.visible = bool(input_hint)
        if input_hint:
            self._field.label = input_hint
            self._tell.label = inspection.verb


def _questions(inspection: Inspection) -> str:
    """Return the questions as buttons, those beyond the row in a list that opens, and a line about the one asked."""
    row = "".join(_choice(inspection, name, escape(_ROW[name])) for name in _ROW if name in inspection.offered)
    others = "".join(
        _choice(inspection, name, f"<b>{escape(name)}</b> {escape(inspection.abouts.get(name, ''))}")
        for name in inspection.offered
        if name not in _ROW
    )
    more = f"<details><summary>More …</summary>{others}</details>" if others else ""
    words = '<button type="button" class="lt-words" data-ltvn-toggle="glossary">What do the words mean?</button>'
    asked = f"<b>{escape(inspection.question)}</b> {escape(inspection.abouts.get(inspection.question, ''))}"
    return f'<div class="lt lt-asks">{row}{more}</div><div class="lt lt-note">{asked} {words}</div>'


def _choice(inspection: Inspection, name: str, markup: str) -> str:
    pressed = str(name == inspection.question).lower()
    return (
        f'<button type="button" class="lt-question" aria-pressed="{pressed}" data-ltvn-action="{Action.QUESTION}" '
        f'data-text="{escape(name)}" title="{escape(name)}">{markup}</button>'
    )
