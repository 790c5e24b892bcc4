"""What a tool of the debugger is: it looks at a case and says something, with links to follow.

Owns the interface. Tools live one to a module and know neither the page nor the session's thread.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from html import escape
from typing import Protocol, TypeAlias

from ltvn_core.types import NodeId
from ltvn_viz.debugger.context import DebugContext
from ltvn_viz.session.commands import Command, Seek
from ltvn_viz.session.overlay import EMPTY_OVERLAY, Overlay

EdgeKey: TypeAlias = tuple[NodeId, NodeId]


class QuestionName(StrEnum):
    """The tools, in the order of the list; the value is what the page calls them."""

    NONE = "choose a question …"
    EDGE = "What about this edge?"
    BLAME = "Why is it so?"
    TIME = "What happened when?"
    WHAT_IF = "What if?"
    WHERE = "Where am I?"
    BREAK = "Stop when …"
    COMPARE = "What is different?"
    TRUTH = "What is true?"
    FAILURES = "What failed?"
    COACH = "Where to drive next?"
    HAND = "Change by hand"
    SHARE = "Show somebody"


@dataclass(frozen=True, slots=True)
class Selection:
    """What a person pointed at."""

    node: NodeId | None = None
    edge: EdgeKey | None = None
    before: NodeId | None = None
    """The node that was pointed at before this one."""

    @property
    def pair(self) -> EdgeKey | None:
        """The two nodes that were pointed at last, whether or not an edge joins them."""
        if self.edge is not None:
            return self.edge
        return None if self.node is None or self.before is None else (self.before, self.node)


@dataclass(frozen=True, slots=True)
class QuestionAnswer:
    """What a tool shows."""

    html: str
    """Foreign parts escaped."""
    overlay: Overlay = EMPTY_OVERLAY
    links: tuple[Command, ...] = ()
    """What the links in `html` ask for, by number."""
    input_hint: str = ""
    """What a person may type, as a hint in the empty field; empty hides the field."""
    is_pending: bool = False
    """More is being computed in the background, and will be shown when it is there."""


NOTHING_SELECTED = Selection()
NO_ANSWER = QuestionAnswer("")


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
        self.parts.append(f"<div>{f'<b>{escape(title)}</b> ' if title else ''}{escape(text)} …</div>")

    def add_html(self, markup: str) -> None:
        """Add markup whose foreign parts are escaped."""
        self.parts.append(markup)

    def link(self, label: str, command: Command) -> str:
        """Return a link to be put into `html`."""
        self.links.append(command)
        number = len(self.links) - 1
        return f'<a class="lt-link" data-ltvn-action="follow" data-id="link-{number}">{escape(label)}</a>'

    def time_link(self, seconds: float, label: str = "") -> str:
        """Return a link to a moment, named by its time unless there is a label, to be put into `html`."""
        return self.link(label or f"{seconds:.1f} s", Seek(seconds))

    def add_table(self, head: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
        """Add a table of cells that are markup already."""
        cells = "".join("<tr>" + "".join(f"<td>{cell}</td>" for cell in row) + "</tr>" for row in rows)
        heads = "".join(f"<th>{escape(each)}</th>" for each in head)
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


class Question(Protocol):
    """Answers one kind of question."""

    about: str
    """What it shows, in one line."""

    def answer(self, context: DebugContext, selection: Selection) -> QuestionAnswer:
        """Return what there is to see now; called when case or selection changed, in the session's thread."""
        ...

    def handle_text(self, context: DebugContext, text: str) -> Command | None:
        """Take in what a person typed, and return what that asks for, if anything; raises OptionError or MapError,
        whose words the page shows.
        """
        ...
