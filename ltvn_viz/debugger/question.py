"""What a tool of the debugger is: it looks at a case and says something, with links to follow.

Owns the interface. Tools live one to a module and know neither the page nor the session's thread.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape
from typing import ClassVar, Generic, TypeVar

from ltvn_core import palette
from ltvn_core.errors import OptionError
from ltvn_core.palette import Rgb8
from ltvn_core.types import NodeId
from ltvn_viz.debugger.background_cache import LatestAnswer
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.server.glossary import explained
from ltvn_viz.session.commands import AskQuestion, ChooseQuestion, Command, QuestionRequest, Seek
from ltvn_viz.session.inspection import QuestionAnswer, QuestionName, Selection
from ltvn_viz.session.overlay import EMPTY_OVERLAY, Overlay


@dataclass(slots=True)
class AnswerBuilder:
    """Collects lines of a view and the links in them."""

    parts: list[str] = field(default_factory=list)
    links: list[Command] = field(default_factory=list)
    is_pending: bool = False

    def add_text(self, text: str) -> None:
        """Add a line of plain text."""
        self.parts.append(f"<div>{escape(text)}</div>")

    def add_pending(self, text: str, *, title: str = "") -> None:
        """Say what is being computed in the background, after a title in bold if there is one."""
        self.is_pending = True
        leave = self.link("leave it", ChooseQuestion(QuestionName.NONE))
        bar = f'<div class="lt-bar lt-wait" role="progressbar" aria-label="{escape(text)}"><div></div></div>'
        named = f"<b>{escape(title)}</b> " if title else ""
        self.parts.append(f"<div>{named}{escape(text)} … {leave}{bar}</div>")

    def add_behind(self, latest: LatestAnswer) -> None:
        """Say so where an answer is still that of another moment."""
        if latest.is_behind:
            self.add_pending("What follows is of another moment; looking again")

    def add_html(self, markup: str) -> None:
        """Add markup whose foreign parts are escaped."""
        self.parts.append(markup)

    def link(self, label: str, command: Command) -> str:
        """Return a link to be put into `html`."""
        self.links.append(command)
        number = len(self.links) - 1
        return f'<a class="lt-link" data-ltvn-action="follow" data-id="link-{number}">{escape(label)}</a>'

    def request_link(self, label: str, request: QuestionRequest) -> str:
        """Return a link that asks something of the question that draws it, to be put into `html`."""
        return self.link(label, AskQuestion(request))

    def time_link(self, seconds: float, label: str = "") -> str:
        """Return a link to a moment, named by its time unless there is a label, to be put into `html`."""
        return self.link(label or f"{seconds:.1f} s", Seek(seconds))

    def add_selected_edge(self, selection: Selection) -> dict[NodeId, Rgb8]:
        """Add a link to the question about the edge that is selected, and return how its ends are coloured."""
        if selection.edge is None:
            return {}
        source, target = selection.edge
        more = self.link("its images and attempts", ChooseQuestion(QuestionName.EDGE))
        self.add_html(f"<div>Edge <b>{source} → {target}</b>: {more}</div>")
        return {source: palette.SOURCE, target: palette.TARGET}

    def add_table(self, head: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
        """Add a table of cells that are markup already."""
        cells = "".join("<tr>" + "".join(f"<td>{cell}</td>" for cell in row) + "</tr>" for row in rows)
        heads = "".join(f"<th>{explained(each)}</th>" for each in head)
        self.parts.append(f'<table class="lt-rows"><thead><tr>{heads}</tr></thead><tbody>{cells}</tbody></table>')

    def build(self, overlay: Overlay = EMPTY_OVERLAY, input_hint: str = "") -> QuestionAnswer:
        """Return what was collected."""
        return QuestionAnswer(
            html=f'<div class="lt lt-why">{"".join(self.parts)}</div>',
            overlay=overlay,
            links=tuple(self.links),
            input_hint=input_hint,
            is_pending=self.is_pending,
        )


RequestT = TypeVar("RequestT", bound=QuestionRequest)


class Question(ABC, Generic[RequestT]):
    """Answers one kind of question; `RequestT` is what its links ask of it, Never where they only lead elsewhere.

    To add one: write a class like this and put it into `question_registry`.
    """

    name: ClassVar[str]
    """What the page calls it, different from all others."""
    word: ClassVar[str]
    """The word for it in an address, such as what-if."""
    about: ClassVar[str]
    """What it shows, in one line."""
    verb: ClassVar[str] = "Ask"
    """What handing over what was typed does, as the word on the button."""
    is_for_watchers: ClassVar[bool] = False
    """A page without the seat may ask it too: nothing that it does is noticed elsewhere, and it opens no file."""

    def is_offered(self, context: DebugContext) -> bool:
        """Tell whether the question can be answered in this run at all; asked often, so it must be quick."""
        return True

    @abstractmethod
    def answer(self, context: DebugContext, selection: Selection) -> QuestionAnswer:
        """Return what there is to see now; called when case or selection changed, in the session's thread."""

    def handle_text(self, context: DebugContext, text: str) -> Command | None:
        """Take in what a person typed, and return what that asks for, if anything; raises OptionError or MapError,
        whose words the page shows.
        """
        raise OptionError("Nothing can be typed here; follow a link, or click a node in the scene.")

    def handle_request(self, context: DebugContext, request: RequestT) -> Command | None:
        """Do what a link of this question asks for, and return what that asks of the session, if anything.

        Raises LtvnError, whose words the page shows.
        """
        raise OptionError(f"The question “{self.name}” cannot do this: {request}.")
