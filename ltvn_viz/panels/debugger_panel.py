"""The “Why” tab: one question of the debugger at a time."""

import time
from collections.abc import Callable
from html import escape

import viser

from ltvn_viz.panels.html_widgets import HtmlBlock, note
from ltvn_viz.session.inspection import Inspection, QuestionName
from ltvn_viz.session.snapshot import Snapshot
from ltvn_viz.wishes.commands import Action, Value

ANSWERED_WITHIN_S = 1.0
"""Time in seconds for which a person's choice is shown, before the session's question replaces it."""


class DebuggerPanel:
    """A list of questions, the answer, and a text field for questions that need input."""

    def __init__(
        self, gui: viser.GuiApi, ask: Callable[[Action, Value], None], clock: Callable[[], float] = time.time
    ) -> None:
        """Add the controls to the open tab; `ask` takes actions and returns at once."""
        HtmlBlock(gui, note("Ask about the map and the run: choose a question, then click a node or an edge."))
        self._tools = gui.add_dropdown("Question", [QuestionName.NONE.value])
        self._about = HtmlBlock(gui)
        self._view = HtmlBlock(gui)
        self._field = gui.add_text("What to ask", "", visible=False)
        self._tell = gui.add_button("Ask", visible=False)
        self._offered: tuple[str, ...] = ()
        self._shown = self._tools.value
        self._clock = clock
        self._bind(ask)

    def show(self, snapshot: Snapshot) -> None:
        """Show the question's answer."""
        inspection = snapshot.inspection
        if inspection.offered != self._offered:
            self._offered = inspection.offered
            self._tools.options = [str(question) for question in inspection.offered]
        if self._tools.value != inspection.question and not self._is_choice_pending():
            self._tools.value = self._shown = str(inspection.question)
        self._about.show(_about(inspection))
        self._view.show(inspection.html if inspection.question != QuestionName.NONE else _questions(inspection))
        input_hint = inspection.answer.input_hint
        self._field.visible = self._tell.visible = bool(input_hint)
        if input_hint:
            self._field.label = input_hint
            self._tell.label = inspection.verb

    def _is_choice_pending(self) -> bool:
        # A snapshot may be older than a person's choice, and must not overwrite it.
        is_own = self._tools.value != self._shown
        return is_own and self._clock() - self._tools.update_timestamp <= ANSWERED_WITHIN_S

    def _bind(self, ask: Callable[[Action, Value], None]) -> None:
        @self._tools.on_update
        async def _(event: viser.GuiEvent) -> None:
            # Updates by the app itself have no client.
            if event.client_id is not None:
                ask(Action.QUESTION, self._tools.value)

        @self._tell.on_click
        async def _(_: viser.GuiEvent) -> None:
            ask(Action.TELL, self._field.value)


def _about(inspection: Inspection) -> str:
    words = '<button type="button" class="lt-words" data-ltvn-toggle="glossary">What do the words mean?</button>'
    back = "" if inspection.question == QuestionName.NONE else _choice(QuestionName.NONE, "lt-words", "All questions")
    return f'<div class="lt lt-note">{escape(inspection.about)} {words} {back}</div>'


def _questions(inspection: Inspection) -> str:
    """Return the list of questions, each with one line about its answer."""
    rows = (
        _choice(name, "lt-question", f"<b>{escape(name)}</b> {escape(inspection.abouts.get(name, ''))}")
        for name in inspection.offered
        if name != QuestionName.NONE
    )
    return f'<div class="lt">{"".join(rows)}</div>'


def _choice(name: str, style: str, markup: str) -> str:
    return (
        f'<button type="button" class="{style}" data-ltvn-action="{Action.QUESTION}" data-text="{escape(name)}">'
        f"{markup}</button>"
    )
