"""A question of another package: checked when it is made, and never the end of a page, of `why` or of `mcp`.

Owns the check of its attributes, and what becomes of its failures: each is shown as its answer or as its message.
"""

import re
from typing import Any, cast

from ltvn_core.analysis.answer import Answer, Link
from ltvn_core.analysis.answer_text import answer_json, answer_text
from ltvn_core.errors import LtvnError
from ltvn_core.plugins import Plugin
from ltvn_viz.debugger.answer_html import answer_html
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.debugger.question import AnswerBuilder, Question
from ltvn_viz.session.inspection import Overlay, QuestionAnswer, Selection
from ltvn_viz.wishes.commands import Command

_WORD = re.compile(r"[\w-]+")


class GuardedQuestion(Question[Any]):
    """Passes everything on to a question of another package, and turns its failures into answers and messages."""

    def __init__(self, plugin: Plugin, question: Question[Any]) -> None:
        """Check the attributes of a question. Raises PluginError, which names the one that is missing or wrong."""
        self._plugin = plugin
        self._question = question
        with plugin.running("cannot be used"):
            self.name = self._text("name", question.name)
            self.word = self._word("word", question.word)
            self.earlier_words = tuple(self._word("earlier_words", word) for word in question.earlier_words)
            self.about = self._text("about", question.about)
            self.verb = self._text("verb", question.verb)

    def is_offered(self, context: DebugContext) -> bool:
        """Ask the question; one that fails is offered, so that its answer can say why."""
        try:
            return bool(self._question.is_offered(context))
        except Exception:  # Code of another package may raise anything.
            return True

    def answer(self, context: DebugContext, selection: Selection) -> QuestionAnswer:
        """Return the question's answer, or one that says how it failed."""
        try:
            return self.sound_answer(context, selection)
        except LtvnError as error:
            builder = AnswerBuilder()
            builder.add_line(str(error))
            return builder.build()

    def sound_answer(self, context: DebugContext, selection: Selection) -> QuestionAnswer:
        """Return the question's answer, which a page and a terminal can show.

        Raises the question's own LtvnErrors, and PluginError for any other failure and for what cannot be shown.
        """
        with self._plugin.running("could not answer"):
            self._question.is_offered(context)
            found: object = self._question.answer(context, selection)
            if not (isinstance(found, QuestionAnswer) and isinstance(found.answer, Answer)):
                raise self._plugin.refusal(
                    f"answers with {type(found).__name__}, not with what AnswerBuilder().build() makes"
                )
            if not (isinstance(found.overlay, Overlay) and isinstance(found.input_hint, str)):
                raise self._plugin.refusal("answers with an overlay that is no Overlay, or a hint that is no text")
            answer_html(found.answer)
            answer_text(found.answer)
            answer_json(found.answer)
            wrong: list[Link] = [link for link in found.answer.links() if not isinstance(link.to, Command)]
            if wrong:
                raise self._plugin.refusal(
                    f"answers with a link to {wrong[0].to!r:.60}; make links with request_link, time_link or edge_link"
                )
            return found

    def handle_text(self, context: DebugContext, text: str) -> Command | None:
        """Pass typed text on. Raises LtvnError."""
        with self._plugin.running("could not take the text"):
            return self._command(self._question.handle_text(context, text))

    def handle_request(self, context: DebugContext, request: Any) -> Command | None:
        """Pass the request of a link on. Raises LtvnError."""
        with self._plugin.running("could not follow the link"):
            return self._command(self._question.handle_request(context, request))

    def _command(self, found: Any) -> Command | None:
        if not (found is None or isinstance(found, Command)):
            raise self._plugin.refusal(f"returns {found!r:.60}, not a command or None")
        return cast(Command | None, found)

    def _text(self, attribute: str, value: object) -> str:
        if not (isinstance(value, str) and value.strip()):
            raise self._plugin.refusal(f"has no `{attribute}`, which must be a text, but {value!r:.60}")
        return value

    def _word(self, attribute: str, value: object) -> str:
        if not _WORD.fullmatch(self._text(attribute, value)):
            raise self._plugin.refusal(f"has the `{attribute}` {value!r:.60}; use letters, digits and hyphens alone")
        return str(value)
