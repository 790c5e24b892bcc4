"""The interface of a question of the debugger: it takes a context and returns an answer with links.

Owns the interface. Each question is one module and is independent of the page and of the session's thread.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Generic, TypeVar

from ltvn_core import palette
from ltvn_core.analysis import answer
from ltvn_core.analysis.answer import Answer, Inline, Link, Pending, Strong, joined
from ltvn_core.analysis.map_findings import MapFinding
from ltvn_core.analysis.presence_forecast import PresenceChange
from ltvn_core.errors import OptionError
from ltvn_core.palette import Rgb8
from ltvn_core.types import NodeId
from ltvn_viz.debugger.background_cache import LatestAnswer
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.session.inspection import EMPTY_OVERLAY, Overlay, QuestionAnswer, QuestionName, Selection, stroke
from ltvn_viz.wishes.commands import Action, Ask, AskQuestion, Command, PointAt, QuestionRequest, Seek

__all__ = [
    "AnswerBuilder",
    "DebugContext",
    "Overlay",
    "Question",
    "QuestionAnswer",
    "Selection",
    "edge_link",
    "request_link",
    "stroke",
    "time_link",
]


_PRESENCE_ROWS = 12


class AnswerBuilder(answer.AnswerBuilder):
    """Collects the blocks of an answer for the page."""

    def add_pending(self, text: str, *, title: str = "") -> None:
        """Add a line about a computation in the background, after a bold title if there is one."""
        self.blocks.append(Pending(text, title, Link("leave it", Ask(Action.QUESTION, ""))))

    def add_behind(self, latest: LatestAnswer) -> None:
        """Add a note if the answer still belongs to another moment."""
        if latest.is_behind:
            self.add_pending("The answer below is from another moment; computing a new one")

    def add_selected_edge(self, selection: Selection) -> dict[NodeId, Rgb8]:
        """Add a link to the question about the selected edge, and return the colours of its ends."""
        if selection.edge is None:
            return {}
        source, target = selection.edge
        more = Link("its images and attempts", Ask(Action.QUESTION, QuestionName.EDGE))
        self.add_line("Edge ", Strong(f"{source} → {target}"), ": ", more)
        return {source: palette.SOURCE, target: palette.TARGET}

    def add_next(self, *links: Link) -> None:
        """Add the next questions as buttons; in a terminal, as commands."""
        self.add_line(joined([link._replace(is_button=True) for link in links], " "))

    def add_map_finding(self, found: MapFinding, *, is_first: bool = False) -> None:
        """Add a weakness of a map and links to its pairs of nodes; the first one of a list in bold."""
        links: list[Inline] = []
        for edge, apart in found.pairs:
            links += [", " if links else " ", edge_link(*edge), f" ({apart:.2f})" * (len(found.pairs) > 1)]
        self.add_line(Strong(str(found.finding)) if is_first else str(found.finding), links)

    def add_presence_changes(self, before: str, now: str, changes: Sequence[PresenceChange]) -> None:
        """Add a table of the edges that are open at one of two moments only, with p(open) and state at both."""
        rows = [
            (edge_link(*each.edge), f"{each.before:.2f} {each.states[0]}", f"{each.now:.2f} {each.states[1]}")
            for each in changes[:_PRESENCE_ROWS]
        ]
        self.add_table(("edge", before, now), rows, len(changes))

    def build(self, overlay: Overlay = EMPTY_OVERLAY, input_hint: str = "") -> QuestionAnswer:
        """Return the collected answer."""
        return QuestionAnswer(Answer(tuple(self.blocks)), overlay, input_hint)


def request_link(label: str, request: QuestionRequest) -> Link:
    """Return a link with a request to the question that draws it."""
    return Link(label, AskQuestion(request))


def time_link(seconds: float, label: str = "", *, about: str = "") -> Link:
    """Return a link to a moment, labelled with its time by default."""
    return Link(label or f"{seconds:.1f} s", Seek(seconds), about)


def edge_link(source: NodeId, target: NodeId) -> Link:
    """Return a link that selects an edge, labelled with its ends."""
    return Link(f"{source} → {target}", PointAt(source, target))


def has_map(self: object, context: DebugContext) -> bool:
    """Tell whether the run ever had a map."""
    return len(context.timeline.changes) > 0


def has_query(self: object, context: DebugContext) -> bool:
    """Tell whether the run has any query."""
    return context.timeline.progress_before(len(context.timeline.events)).queries > 0


def is_live(self: object, context: DebugContext) -> bool:
    """Tell whether the live run is on show."""
    return context.is_live


RequestT = TypeVar("RequestT", bound=QuestionRequest)


class Question(ABC, Generic[RequestT]):
    """Answers one kind of question. `RequestT` is the type of the requests of its links, Never if it takes none.

    To add a question, write a subclass and add it to `question_registry`.
    """

    name: str
    """Unique name of the question in the page."""
    word: str
    """Word for the question in an address, such as what-if."""
    earlier_words: tuple[str, ...] = ()
    """Former words for the question in addresses, so that old links still work."""
    about: str
    """Description of the answer, in one line."""
    verb: str = "Ask"
    """Label of the button that submits the typed text."""

    def is_offered(self, context: DebugContext) -> bool:
        """Tell whether the question can be answered in this run at all; called often, so it must be fast."""
        return True

    def __init_subclass__(cls) -> None:
        """Take the words of one of our own questions from its name."""
        if isinstance(name := cls.__dict__.get("name"), QuestionName):
            cls.word, cls.earlier_words = name.word, name.earlier_words

    @abstractmethod
    def answer(self, context: DebugContext, selection: Selection) -> QuestionAnswer:
        """Return the present answer; called in the session's thread when context or selection changed."""

    def handle_text(self, context: DebugContext, text: str) -> Command | None:
        """Handle typed text and return the resulting request, if any; raises OptionError or MapError, whose message the
        page shows."""
        raise OptionError("Nothing can be typed here; follow a link, or choose a node or an edge.")

    def handle_request(self, context: DebugContext, request: RequestT) -> Command | None:
        """Handle the request of a link, and return its command for the session, if any.

        Raises LtvnError, whose message the page shows.
        """
        raise OptionError(f"The question “{self.name}” cannot do this: {request}.")
