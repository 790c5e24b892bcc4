"""Changes for a what-if question: another edge, belief, goal, start, threshold or time.

Owns these changes as data. `analysis.what_if_scenario` puts them into effect on a copy of the map.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import TypeAlias

from ltvn_core.analysis.world_clock import WorldTime
from ltvn_core.graph.deltas import Belief
from ltvn_core.types import NodeId


class WhatIfThreshold(StrEnum):
    """A number of the method, by the paper's name where it has one."""

    R_P = "R_p"
    """Edges that failed and are believed less than this are gone."""
    D_L = "D_l"
    """A robot farther than this from its node is lost."""
    D_M = "D_m"
    """Images nearer than this to a node add nothing; a plan does not feel it."""
    D_C = "D_c"
    """Edges longer than this were never made."""
    BELIEF_WEIGHT = "belief weight"
    FAILURE_PENALTY = "failure penalty"


@dataclass(frozen=True, slots=True)
class WithEdge:
    """The map has this edge."""

    source: NodeId
    target: NodeId
    belief: Belief | None = None
    """None means what the map at hand believes of it, or as firmly as the method allows where it lacks the edge."""


@dataclass(frozen=True, slots=True)
class WithoutEdge:
    """The map lacks this edge."""

    source: NodeId
    target: NodeId


@dataclass(frozen=True, slots=True)
class WithBelief:
    """This is believed of an edge; what is None stays."""

    source: NodeId
    target: NodeId
    p: float | None = None
    mu: float | None = None


@dataclass(frozen=True, slots=True)
class WithGoal:
    """The robot wants to go elsewhere."""

    goal: NodeId


@dataclass(frozen=True, slots=True)
class WithStart:
    """The robot is elsewhere."""

    source: NodeId


@dataclass(frozen=True, slots=True)
class WithThreshold:
    """The method has another threshold."""

    threshold: WhatIfThreshold
    value: float


@dataclass(frozen=True, slots=True)
class WithTime:
    """It is later, and nobody looked meanwhile."""

    time: WorldTime


WhatIfChange: TypeAlias = WithEdge | WithoutEdge | WithBelief | WithGoal | WithStart | WithThreshold | WithTime
