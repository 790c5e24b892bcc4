"""One step of an explanation: a sentence, and where in the run to look for oneself.

Owns the shape, and how causes and beliefs are said. The explanations are made in `analysis.edge_explanation`
and `analysis.plan_alternative`.
"""

from dataclasses import dataclass
from enum import StrEnum

from ltvn_core.analysis.timeline_records import Instant
from ltvn_core.graph.deltas import Belief, Cause
from ltvn_core.types import NodeId


class ExplanationKind(StrEnum):
    """What a sentence is about."""

    BORN = "born"
    """An edge or node came in."""
    ATTEMPT = "attempt"
    """An edge was driven."""
    BELIEF = "belief"
    """What all evidence together came to."""
    GONE = "gone"
    """An edge or node left."""
    PLAN = "plan"
    """A plan led that way."""
    PENALTY = "penalty"
    """An edge cost more in one query."""
    ALTERNATIVE = "alternative"
    """What another way would have cost."""
    NEVER = "never"
    """Something never happened."""


@dataclass(frozen=True, slots=True)
class ExplanationStep:
    """A sentence with its links."""

    text: str
    instant: Instant | None
    """Where to jump to; None where there is no one moment."""
    kind: ExplanationKind
    ids: tuple[NodeId, ...]
    """The nodes it speaks of, to be shown; source and target of an edge."""


CAUSE_TEXTS = {
    Cause.BUILD: "when the map was built",
    Cause.ONLINE: "while somebody drove",
    Cause.ATTEMPT: "after it was driven",
    Cause.NOVEL: "because the robot was lost and nobody recognised what it saw",
    Cause.EXPAND: "because there was no path without it",
    Cause.GOAL: "to tie in a goal",
    Cause.LOAD: "with a map out of a file",
    Cause.SIGHT: "because of what was seen",
    Cause.HAND: "by hand",
}
"""How each cause is said."""


def belief_text(belief: Belief) -> str:
    """Say a belief."""
    return f"p = {belief.p:.2f}, mu = {belief.mu:.2f}"


def count_text(count: int, thing: str, things: str = "") -> str:
    """Say how many things there are, such as "3 edges"; `things` is the plural where it is not made with an s."""
    return f"{count} {thing}" if count == 1 else f"{count} {things or f'{thing}s'}"
