"""The interface of a tool of the debugger: it takes a case and returns an answer with links.

Owns the interface. Each tool is one module and knows neither the page nor the session's thread.
"""

from abc import ABC, abstractmethod
from typing import ClassVar, Generic, TypeVar

from ltvn_core import palette
from ltvn_core.analysis import answer
from ltvn_core.analysis.answer import Answer, Link, Pending, Strong
from ltvn_core.errors import OptionError
from ltvn_core.palette import Rgb8
from ltvn_core.types import NodeId
from ltvn_viz.debugger.background_cache import LatestAnswer
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.session.inspection import EMPTY_OVERLAY, Overlay, QuestionAnswer, QuestionName, Selection
from ltvn_viz.wishes.commands import AskQuestion, ChooseQuestion, Command, PointAt, QuestionRequest, Seek


class AnswerBuilder(answer.AnswerBuilder):
    """Collects the blocks of an answer for the page."""

    def add_pending(self, text: str, *, title: str = "") -> None:
        """Say what is being computed in the background, after a bold title if there is one."""
        self.blocks.append(Pending(text, title, Link("leave it", ChooseQuestion(QuestionName.NONE))))

    def add_behind(self, latest: LatestAnswer) -> None:
        """Say so where an answer is still that of another moment."""
        if latest.is_behind:
            self.add_pending("What follows is of another moment; looking again")

    def add_selected_edge(self, selection: Selection) -> dict[NodeId, Rgb8]:
        """Add a link to the question about the edge that is selected, and return how its ends are coloured."""
        if selection.edge is None:
            return {}
        source, target = selection.edge
        more = Link("its images and attempts", ChooseQuestion(QuestionName.EDGE))
        self.add_line("Edge ", Strong(f"{source} → {target}"), ": ", more)
        return {source: palette.SOURCE, target: palette.TARGET}

    def build(self, overlay: Overlay = EMPTY_OVERLAY, input_hint: str = "") -> QuestionAnswer:
        """Return the collected answer."""
        return QuestionAnswer(Answer(tuple(self.blocks)), overlay, input_hint)


def request_link(label: str, request: QuestionRequest) -> Link:
    """Return a link that asks something of the question that draws it."""
    return Link(label, AskQuestion(request))


def time_link(seconds: float, label: str = "", *, about: str = "") -> Link:
    """Return a link to a moment, named by its time unless there is a label."""
    return Link(label or f"{seconds:.1f} s", Seek(seconds), about)


def edge_link(source: NodeId, target: NodeId) -> Link:
    """Return a link that selects an edge, named by its ends."""
    return Link(f"{source} → {target}", PointAt(source, target))


RequestT = TypeVar("RequestT", bound=QuestionRequest)


class Question(ABC, Generic[RequestT]):
    """Answers one kind of question; `RequestT` is the type of its links' requests, Never if they only lead elsewhere.

    To add one: write a class like this and put it into `question_registry`.
    """

    name: ClassVar[str]
    """Its unique name in the page."""
    word: ClassVar[str]
    """The word for it in an address, such as what-if."""
    earlier_words: ClassVar[tuple[str, ...]] = ()
    """Former words for it in addresses, so that old links still work."""
    about: ClassVar[str]
    """What it shows, in one line."""
    verb: ClassVar[str] = "Ask"
    """Label of the button that submits the typed text."""
    is_for_watchers: ClassVar[bool] = False
    """A page without the seat may ask it too: nothing that it does is noticed elsewhere, and it opens no file."""

    def is_offered(self, context: DebugContext) -> bool:
        """Tell whether the question can be answered in this run at all; asked often, so it must be quick."""
        return True

    @abstractmethod
    def answer(self, context: DebugContext, selection: Selection) -> QuestionAnswer:
        """Return the answer for now; called when case or selection changed, in the session's thread."""

    def handle_text(self, context: DebugContext, text: str) -> Command | None:
        """Handle typed text and return the resulting request, if any; raises OptionError or MapError, whose message the
        page shows."""
        raise OptionError("Nothing can be typed here; follow a link, or click a node in the scene.")

    def handle_request(self, context: DebugContext, request: RequestT) -> Command | None:
        """Handle the request of a link, and return what it asks of the session, if anything.

        Raises LtvnError, whose message the page shows.
        """
        raise OptionError(f"The question “{self.name}” cannot do this: {request}.")
