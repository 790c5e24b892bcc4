"""Moments worth stopping at, as data.

Owns the kinds of breakpoints. How one is typed is `analysis.breakpoint_parser`, when one is met
`analysis.breakpoint_rules`.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import TypeAlias

from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.types import NodeId


class BreakpointTrigger(StrEnum):
    """What can happen, in the words one types."""

    PRUNE = "prune"
    EXPANSION = "expand"
    COLLISION = "collision"
    REPLAN = "replan"
    FAILED_ATTEMPT = "failed leg"
    LOST = "lost"
    NO_PATH = "no path"
    HAND = "by hand"


class BreakpointQuantity(StrEnum):
    """Numbers that a condition can be about."""

    MARGIN = "margin"
    DISTANCE = "distance"
    REACHABILITY = "r"
    P = "p"
    MU = "mu"


@dataclass(frozen=True, slots=True)
class EventBreakpoint:
    """Stop when this happens."""

    trigger: BreakpointTrigger


@dataclass(frozen=True, slots=True)
class BeliefCrossingBreakpoint:
    """Stop when the p of any edge crosses a level, either way."""

    level: float
    is_prune_threshold: bool = False
    """The level was asked for as R_p, below which edges are pruned, and is shown by that name."""


@dataclass(frozen=True, slots=True)
class LocalisationBreakpoint:
    """Stop at each look whose margin, distance or reachability is so."""

    quantity: BreakpointQuantity
    less: bool
    """Below the value; else above it."""
    value: float


@dataclass(frozen=True, slots=True)
class EdgeBeliefBreakpoint:
    """Stop when p or mu of one edge becomes so; not again until it was otherwise."""

    quantity: BreakpointQuantity
    edge: EdgeKey
    less: bool
    value: float


@dataclass(frozen=True, slots=True)
class EdgeBreakpoint:
    """Stop whenever an edge is driven or changed."""

    edge: EdgeKey


@dataclass(frozen=True, slots=True)
class NodeBreakpoint:
    """Stop whenever the robot is at a node, heads for it, or the node changes."""

    node: NodeId


Breakpoint: TypeAlias = (
    EventBreakpoint
    | BeliefCrossingBreakpoint
    | LocalisationBreakpoint
    | EdgeBeliefBreakpoint
    | EdgeBreakpoint
    | NodeBreakpoint
)
