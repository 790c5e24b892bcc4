"""Changes for a what-if question: another edge, belief, goal, start, threshold or time.

Owns these changes as data, and parsing and formatting of their text form: "without 12->40", "p(12->40) = 0.1", "goal
120", "D_c = 1.3", "at 18:00". `analysis.replanning` applies them to a copy of the map.
"""

import re
from dataclasses import dataclass
from enum import StrEnum
from typing import TypeAlias, assert_never

from ltvn_core.analysis.world_clock import TIME_EXAMPLES, WorldTime, format_world_time, parse_world_time
from ltvn_core.errors import OptionError
from ltvn_core.graph.deltas import Belief
from ltvn_core.terminal_text import parse_number
from ltvn_core.types import NodeId

_EDGE = r"(\d+)\s*(?:->|→)\s*(\d+)"
_PRESENCE = re.compile(rf"(with|without)\s+{_EDGE}", re.IGNORECASE)
_BELIEF = re.compile(rf"(p|mu)\s*\(\s*{_EDGE}\s*\)\s*=\s*(\S+)", re.IGNORECASE)
_PLACE = re.compile(r"(goal|from)\s+(\d+)", re.IGNORECASE)
_TIME = re.compile(r"(at|in)\s.*|\d{1,2}:\d{2}", re.IGNORECASE)
_THRESHOLD = re.compile(r"([A-Za-z_ ]+?)\s*=\s*(\S+)")


class WhatIfThreshold(StrEnum):
    """A number of the method, by its name in the paper if it has one."""

    R_P = "R_p"
    """p below which an edge that failed is pruned."""
    D_L = "D_l"
    """d above which the robot is not at a node, and is lost."""
    D_C = "D_c"
    """d above which no edge is made."""
    BELIEF_WEIGHT = "belief weight"
    FAILURE_PENALTY = "failure penalty"


@dataclass(frozen=True, slots=True)
class WithEdge:
    """The map has this edge, with this belief."""

    source: NodeId
    target: NodeId
    belief: Belief | None = None
    """Belief of the edge; None keeps the belief in the map, or gives a new edge the highest p that the method
    allows."""


@dataclass(frozen=True, slots=True)
class WithoutEdge:
    """The map does not have this edge."""

    source: NodeId
    target: NodeId


@dataclass(frozen=True, slots=True)
class WithBelief:
    """The belief of an edge has other values; None keeps a value."""

    source: NodeId
    target: NodeId
    p: float | None = None
    mu: float | None = None


@dataclass(frozen=True, slots=True)
class WithGoal:
    """The robot has another goal."""

    goal: NodeId


@dataclass(frozen=True, slots=True)
class WithStart:
    """The robot is at another node."""

    source: NodeId


@dataclass(frozen=True, slots=True)
class WithThreshold:
    """A threshold of the method has another value."""

    threshold: WhatIfThreshold
    value: float


@dataclass(frozen=True, slots=True)
class WithTime:
    """The time is later, without observations in between."""

    time: WorldTime


WhatIfChange: TypeAlias = WithEdge | WithoutEdge | WithBelief | WithGoal | WithStart | WithThreshold | WithTime

WHAT_IF_EXAMPLES = (
    "without 12->40",
    "with 12->40",
    "p(12->40) = 0.1",
    "mu(12->40) = 2",
    "goal 120",
    "from 12",
    *(f"{threshold} = 1.3" for threshold in WhatIfThreshold),
    *TIME_EXAMPLES,
)
"""Examples of all forms, for help texts."""

_THRESHOLDS = {threshold.value.lower(): threshold for threshold in WhatIfThreshold}


def parse_what_if_change(text: str) -> WhatIfChange:
    """Parse a change. Raises OptionError, which lists the valid forms, for anything else."""
    words = " ".join(text.split())
    if found := _PRESENCE.fullmatch(words):
        edge = int(found[2]), int(found[3])
        return WithEdge(*edge) if found[1].lower() == "with" else WithoutEdge(*edge)
    if found := _BELIEF.fullmatch(words):
        edge = (int(found[2]), int(found[3]))
        value = parse_number(found[4], text, "nothing to imagine")
        return WithBelief(*edge, p=value) if found[1].lower() == "p" else WithBelief(*edge, mu=value)
    if found := _PLACE.fullmatch(words):
        return WithGoal(int(found[2])) if found[1].lower() == "goal" else WithStart(int(found[2]))
    if _TIME.fullmatch(words):
        return WithTime(parse_world_time(words))
    found = _THRESHOLD.fullmatch(words)
    if found and (threshold := _THRESHOLDS.get(found[1].lower())) is not None:
        return WithThreshold(threshold, parse_number(found[2], text, "nothing to imagine"))
    raise OptionError(
        f"{text[:60]!r} is not a change that can be imagined; write one of: {', '.join(WHAT_IF_EXAMPLES)}."
    )


def format_what_if_change(change: WhatIfChange) -> str:
    """Return the text of a change; parsing it gives the same change, unless it is an edge with its own belief."""
    match change:
        case WithEdge(source, target):
            return f"with {source}->{target}"
        case WithoutEdge(source, target):
            return f"without {source}->{target}"
        case WithBelief(source, target, None, mu):
            return f"mu({source}->{target}) = {mu!r}"
        case WithBelief(source, target, p):
            return f"p({source}->{target}) = {p!r}"
        case WithGoal(goal):
            return f"goal {goal}"
        case WithStart(source):
            return f"from {source}"
        case WithThreshold(threshold, value):
            return f"{threshold.value} = {value!r}"
        case WithTime(time):
            return format_world_time(time)
    assert_never(change)
