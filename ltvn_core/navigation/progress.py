"""Progress of navigation after some events: goal, plan and attempt, and counts over the run.

Holds no map. `navigation.event_table` says what each event changes.
"""

import itertools
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.navigation import events as e
from ltvn_core.types import NodeId
from ltvn_core.worlds import AS_MADE, WorldState


class NavigationProgress(NamedTuple):
    """The state of navigation after some events."""

    navigator: e.NavigatorState = e.NavigatorState.IDLE
    query: int | None = None
    """The query in progress; None if there is none."""
    goal: NodeId | None = None
    plan: tuple[NodeId, ...] = ()
    last_plan: tuple[NodeId, ...] | None = None
    """The latest path of the latest query, also after its end; None before its first."""
    attempt: e.AttemptStarted | None = None
    """The attempt in progress; None if there is none."""
    action: e.ActionBegun | None = None
    """The action that the robot waits for; None if there is none."""
    localised: e.Localised | None = None
    """The latest localisation."""
    ended: e.QueryEnded | None = None
    """The end of the latest query; None if it has not ended."""
    judged: e.Judged | None = None
    """In simulation, the verdict on the latest query by the ground truth."""
    note: e.Note | None = None
    """The latest note of the robot."""
    failures: Mapping[EdgeKey, int] = MappingProxyType({})
    """Number of failures of each edge in the latest query."""
    queries: int = 0
    reached: int = 0
    """Number of queries in which the robot declared arrival."""
    collisions: int = 0
    pruned: int = 0
    """Number of edges that were pruned since the map was built or opened."""
    added: int = 0
    """Number of edges that were added since the map was built or opened."""
    blocked: frozenset[EdgeKey] = frozenset()
    """Edges of the map whose last observation showed them blocked."""
    seen_blocked: int = 0
    """Number of observations of blocked edges, including those that came with the map."""
    obstructions: int = 0
    """Number of obstructions in the latest query."""
    obstructed_s: float | None = None
    """Time of the latest obstruction, in seconds of the world."""
    world: WorldState = AS_MADE
    """In simulation, the state of the world."""


NO_PROGRESS = NavigationProgress()


def edges_between(path: Sequence[NodeId], source: NodeId, target: NodeId) -> tuple[EdgeKey, ...]:
    """Return the edges of a path between two of its nodes, or the direct edge if the path does not contain both in
    order.

    An attempt to a subgoal farther ahead drives all of these edges, and its failure counts against each.
    """
    if source in path and target in path[path.index(source) + 1 :]:
        return tuple(itertools.pairwise(path[path.index(source) : path.index(target) + 1]))
    return ((source, target),)
