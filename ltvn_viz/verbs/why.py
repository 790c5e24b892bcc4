"""`ltvn why`: any question of the Why tab about a recording or a map, answered in the terminal."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tyro.conf import Positional

from ltvn_core.verbs.verb import OwnWords, Verb

if TYPE_CHECKING:
    from ltvn_viz.debugger.file_questions import FileAnswer


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
    said: "FileAnswer"

    def as_text(self) -> str:
        """Return the answer's lines and tables, then the commands of the next questions."""
        from ltvn_core.analysis.answer_text import answer_text

        following = [self._command_line(link.to) for link in self.said.answer.links() if link.is_button]
        return "\n".join([answer_text(self.said.answer), *filter(None, following)])

    def as_json(self) -> dict[str, Any]:
        """Return the question and the answer's blocks, with links as command lines."""
        from ltvn_core.analysis.answer_text import answer_json

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


@dataclass(frozen=True, kw_only=True)
class WhyVerb(Verb):
    """Ask the debugger's questions about a recording or a map, in the terminal. Without a question, list all questions
    that can be answered."""

    file: Positional[Path]
    """The .rrd file; it is not changed."""
    ask: str = ""
    """The question, by its word: edge (why is it so?), failures (what failed?), what-if, time, where, compare, truth,
    or another word of the list. By default, edge for --edge and --node, and failures for --query."""
    at: float | None = None
    """Time in seconds after the beginning of the recording; by default the end of the query or of the recording."""
    edge: tuple[int, int] | None = None
    """Select the edge between two nodes: its source and its target."""
    node: int | None = None
    """Select a node."""
    query: int | None = None
    """Select a navigation task, by its number."""
    text: str = ""
    """Text for the question, as a person would type it, for instance --ask what-if --text "without 12->40"."""
    weights: Path | None = None
    """The weights with which the file was made, if not the shipped ones, for questions that compare images."""

    def run(self) -> OfferedQuestions | TerminalAnswer:
        """Answer the question, or list all questions; raises RecordingError, and OptionError that lists valid
        values."""
        from ltvn_viz.debugger.file_context import FileCase
        from ltvn_viz.debugger.file_questions import FileAsk, ask_file, offered_questions

        asked = FileAsk(
            question=self.ask, at_s=self.at, edge=self.edge, node=self.node, query=self.query, text=self.text
        )
        case = FileCase(self.file, weights=self.weights)
        if not asked.word:
            return OfferedQuestions(self.file, offered_questions(case))
        return TerminalAnswer(self.file, ask_file(case, asked))
