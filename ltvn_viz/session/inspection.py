"""What the page shows of the debugger, as plain data: the question, what is selected, the answer and what it draws.

Owns no answer; the questions are in `ltvn_viz.debugger`, and the page draws what they return.
"""

import re
from dataclasses import dataclass
from enum import StrEnum
from typing import Self

from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.types import NodeId
from ltvn_viz.session.commands import Command
from ltvn_viz.session.overlay import EMPTY_OVERLAY, Overlay

LINKS_PER_VIEW = 1000
"""A link is asked for by its number plus so many times the number of the view it was drawn in."""
_LINK_ID = re.compile(r'data-id="link-(\d+)"')


class QuestionName(StrEnum):
    """What the page calls the questions to which others lead, each with its word in an address.

    A question that nothing else leads to has a name and a word of its own, and needs no member here.
    """

    word: str

    def __new__(cls, name: str, word: str) -> Self:
        """Make a member whose value is `name`."""
        member = str.__new__(cls, name)
        member._value_ = name
        member.word = word
        return member

    NONE = "choose a question …", ""
    EDGE = "What about this edge?", "edge"
    BLAME = "Why is it so?", "blame"
    TIME = "What happened when?", "time"
    WHAT_IF = "What if?", "what-if"
    PRESENCE = "When is it open?", "presence"
    TRIED = "Why did it try the door?", "tried"
    WHERE = "Where am I?", "where"
    BREAK = "Stop when …", "break"
    COMPARE = "What is different?", "compare"
    TRUTH = "What is true?", "truth"
    FAILURES = "What failed?", "failures"
    COACH = "Where to drive next?", "coach"
    HAND = "Change by hand", "hand"
    SHARE = "Show somebody", "share"


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

    question: str = QuestionName.NONE
    """Its name, as the page calls it."""
    about: str = ""
    verb: str = ""
    """What handing over what was typed does, for the button."""
    answer: QuestionAnswer = NO_ANSWER
    serial: int = 0
    """Counts views; part of every link."""
    selection: Selection = NOTHING_SELECTED
    offered: tuple[str, ...] = (QuestionName.NONE,)
    notice: str = ""
    """What the page that asks is to be told, and no other."""
    notice_number: int = 0
    """Counts notices, so that the same words twice are two."""

    @property
    def html(self) -> str:
        """The view's markup, with links that carry its number."""
        return _LINK_ID.sub(lambda found: f'data-id="{self.serial * LINKS_PER_VIEW + int(found[1])}"', self.answer.html)


NO_INSPECTION = Inspection()
