"""The debugger's state for the page, as plain data: the question, the selection, the answer and its drawing.

Owns no answer; the questions are in `ltvn_viz.debugger`, and the page draws what they return.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Self, cast

import numpy as np
from numpy.typing import NDArray

from ltvn_core.analysis.answer import EMPTY_ANSWER, Answer
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.palette import Rgb8
from ltvn_core.types import NodeId, Pose
from ltvn_viz.wishes.commands import Command


@dataclass(frozen=True, slots=True)
class Stroke:
    """A line between two places on the floor."""

    start: tuple[float, float]
    """x, y in metres."""
    end: tuple[float, float]
    colour: Rgb8


@dataclass(frozen=True, slots=True)
class Label:
    """A few words at a place."""

    at: tuple[float, float]
    text: str


@dataclass(frozen=True, slots=True)
class Overlay:
    """Everything that one tool draws."""

    strokes: tuple[Stroke, ...] = ()
    nodes: dict[NodeId, Rgb8] = field(default_factory=dict)
    """Nodes in another colour."""
    ghosts: tuple[tuple[float, float, float], ...] = ()
    """Poses x, y, yaw at which a see-through robot stands."""
    labels: tuple[Label, ...] = ()
    is_of_likeness: bool = False
    """Whether nodes are coloured by the similarity of their images."""


EMPTY_OVERLAY = Overlay()


def stroke(start: Pose | NDArray[np.float64], end: Pose | NDArray[np.float64], colour: Rgb8) -> Stroke:
    """Return a line between two poses or points (>=2,)."""
    return Stroke((float(start[0]), float(start[1])), (float(end[0]), float(end[1])), colour)


LINKS_PER_VIEW = 1000
"""Offset between the links of two views: a link's number is its index plus this times the view's number."""
_LINK_ID = re.compile(r'data-id="link-(\d+)"')


class QuestionName(StrEnum):
    """Questions that others link to, each with its word in an address.

    A question without links to it defines its own name and word, and needs no member here.
    """

    word: str
    earlier_words: tuple[str, ...]
    """Former words for it in addresses, so that old links still work."""

    def __new__(cls, name: str, word: str, *earlier_words: str) -> Self:
        """Make a member whose value is `name`."""
        member = str.__new__(cls, name)
        member._value_ = name
        member.word = word
        member.earlier_words = earlier_words
        return member

    FIRST = "What went wrong here?", "wrong"
    """The question on show while a person asks no other; clicks on the map are not for it."""
    EDGE = "What about this edge?", "edge", "blame", "presence", "tried"
    TIME = "What happened when?", "time"
    DECISIONS = "What did it decide?", "decisions"
    WHAT_IF = "What if?", "what-if"
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
    """The selection of a person."""

    node: NodeId | None = None
    edge: EdgeKey | None = None
    before: NodeId | None = None
    """The node that was selected before this one."""
    query: int | None = None
    """The only navigation task to speak of, by its number; None for all. A page selects none."""

    @property
    def pair(self) -> EdgeKey | None:
        """The two nodes that were selected last, whether or not an edge joins them."""
        if self.edge is not None:
            return self.edge
        return None if self.node is None or self.before is None else (self.before, self.node)


@dataclass(frozen=True, slots=True)
class QuestionAnswer:
    """The answer to a question."""

    answer: Answer = EMPTY_ANSWER
    """Answer whose links request commands."""
    overlay: Overlay = EMPTY_OVERLAY
    input_hint: str = ""
    """Hint in the empty text field; empty hides the field."""

    @property
    def links(self) -> tuple[Command, ...]:
        """Return the requests of the links, in reading order."""
        return tuple(cast(Command, link.to) for link in self.answer.links())

    @property
    def is_pending(self) -> bool:
        """Whether a part of the answer is still being computed in the background."""
        return self.answer.is_pending


NOTHING_SELECTED = Selection()
NO_ANSWER = QuestionAnswer()


@dataclass(frozen=True, slots=True, eq=False)
class Inspection:
    """The debugger's state for the page."""

    question: str = QuestionName.FIRST
    """Name of the question in the page."""
    verb: str = ""
    """Label of the button that submits the typed text."""
    answer: QuestionAnswer = NO_ANSWER
    serial: int = 0
    """Counts views; part of every link."""
    selection: Selection = NOTHING_SELECTED
    offered: tuple[str, ...] = (QuestionName.FIRST,)
    abouts: Mapping[str, str] = field(default_factory=dict)
    """One line about each question, by its name."""
    markup: str = ""
    """The answer as HTML, its links numbered from 0."""

    @property
    def html(self) -> str:
        """The answer as HTML, with links that carry the number of this view."""
        return _LINK_ID.sub(lambda found: f'data-id="{self.serial * LINKS_PER_VIEW + int(found[1])}"', self.markup)


NO_INSPECTION = Inspection()
