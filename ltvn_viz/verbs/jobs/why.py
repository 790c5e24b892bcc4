"""`ltvn why`: any question of the Why tab about a recording or a map, answered in the terminal."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ltvn_core.analysis.answer_text import answer_json, answer_text
from ltvn_core.verbs.verb import OwnWords, Summary
from ltvn_viz.debugger.file_context import FileCase
from ltvn_viz.debugger.file_questions import FileAnswer, FileAsk, ask_file, offered_questions
from ltvn_viz.verbs.why import WhyVerb


@dataclass(frozen=True)
class OfferedQuestions(OwnWords):
    """The questions that can be answered for a file."""

    file: Path
    questions: Mapping[str, str]
    """Description of each question, by its word."""

    def as_text(self) -> str:
        """Return a line for each question."""
        width = max(map(len, self.questions), default=0)
        return "\n".join(f"{word:<{width}}  {about}" for word, about in self.questions.items())

    def as_json(self) -> dict[str, Any]:
        """Return the questions as a list."""
        listed = [{"question": word, "about": about} for word, about in self.questions.items()]
        return {"file": str(self.file), "questions": listed}


@dataclass(frozen=True)
class TerminalAnswer(OwnWords):
    """An answer for the terminal or for a program."""

    file: Path
    said: FileAnswer

    def as_text(self) -> str:
        """Return the answer's lines and tables."""
        return answer_text(self.said.answer)

    def as_json(self) -> dict[str, Any]:
        """Return the question and the answer's blocks, with links as command lines."""
        asked = self.said.asked
        return {
            "file": str(self.file),
            "question": asked.word,
            "at_s": None if asked.at_s is None else round(asked.at_s, 3),
            "about": asked.about,
            "blocks": answer_json(self.said.answer, target=self._command_line),
        }

    def _command_line(self, link: object) -> str | None:
        following = self.said.asked.following(link)
        return None if following is None else following.command_line(str(self.file))


def ask(options: WhyVerb) -> Summary:
    """Answer the question, or list all questions; raises RecordingError, and OptionError that lists valid values."""
    asked = FileAsk(
        question=options.ask,
        at_s=options.at,
        edge=options.edge,
        node=options.node,
        query=options.query,
        text=options.text,
    )
    case = FileCase(options.file, weights=options.weights)
    if not asked.word:
        return OfferedQuestions(options.file, offered_questions(case))
    return TerminalAnswer(options.file, ask_file(case, asked))
