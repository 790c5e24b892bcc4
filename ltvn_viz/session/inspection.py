"""What the page shows of the debugger, as plain data: the question, what is selected, the answer and what it draws.

Owns no answer; the questions are in `ltvn_viz.debugger`, and the page draws what they return.
"""

import re
from dataclasses import dataclass
from enum import StrEnum

from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.types import NodeId
from ltvn_viz.session.commands import Command
from ltvn_viz.session.overlay import EMPTY_OVERLAY, Overlay

LINKS_PER_VIEW = 1000
"""A link is asked for by its number plus so many times the number of the view it was drawn in."""
_LINK_ID = re.compile(r'data-id="link-(\d+)"')


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
        return _LINK_ID.sub(lambda found: f'data-id="{self.serial * LINKS_PER_VIEW + int(found[1])}"', self.answer.html)


NO_INSPECTION = Inspection()
