"""What the robot would have planned, had something been otherwise.

Owns the changes one can imagine and the comparison of both plans. Works on copies: neither the map nor the recording
is touched. Counting what other thresholds would do to the map is `analysis.dry_run`.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import TypeAlias

from ltvn_core.analysis.situation import Situation
from ltvn_core.config import Method
from ltvn_core.errors import MapError, OptionError
from ltvn_core.geometry import distance
from ltvn_core.graph.deltas import Belief, BeliefUpdated, Cause, Edge, EdgeAdded, EdgePruned, PoseRow
from ltvn_core.graph.planner import Path, Planner, edge_cost
from ltvn_core.graph.topograph import EdgeKey, TopologicalGraph
from ltvn_core.types import NodeId


class Threshold(StrEnum):
    """A number of the method, by the paper's name where it has one."""

    R_P = "R_p"
    """Edges that failed and are believed less than this are gone."""
    D_L = "D_l"
    """A robot farther than this from its node is lost."""
    D_M = "D_m"
    D_C = "D_c"
    """Edges longer than this were never made."""
    BELIEF_WEIGHT = "belief weight"
    FAILURE_PENALTY = "failure penalty"


@dataclass(frozen=True, slots=True)
class EdgeForced:
    """The map has this edge, with this belief."""

    source: NodeId
    target: NodeId
    belief: Belief


@dataclass(frozen=True, slots=True)
class EdgeBarred:
    """The map lacks this edge."""

    source: NodeId
    target: NodeId


@dataclass(frozen=True, slots=True)
class BeliefSet:
    """This is believed of an edge; what is None stays."""

    source: NodeId
    target: NodeId
    p: float | None = None
    mu: float | None = None


@dataclass(frozen=True, slots=True)
class GoalSet:
    """The robot wants to go elsewhere."""

    goal: NodeId


@dataclass(frozen=True, slots=True)
class StartSet:
    """The robot is elsewhere."""

    source: NodeId


@dataclass(frozen=True, slots=True)
class ThresholdSet:
    """The method has another threshold."""

    threshold: Threshold
    value: float


Change: TypeAlias = EdgeForced | EdgeBarred | BeliefSet | GoalSet | StartSet | ThresholdSet


@dataclass(frozen=True, slots=True)
class PricedEdge:
    """What one edge of a path costs, part by part."""

    edge: EdgeKey
    mu: float
    """Believed length."""
    doubt: float
    """-weight * ln p."""
    penalty: float
    """For failures earlier in the query."""


@dataclass(frozen=True, slots=True)
class Replanned:
    """Two plans side by side."""

    old: Path
    new: Path
    old_edges: tuple[PricedEdge, ...]
    """Along the old path."""
    new_edges: tuple[PricedEdge, ...]
    """Along the new path, under the changes."""
    left: tuple[EdgeKey, ...]
    """Edges of the old path that the new one does without, in order."""
    joined: tuple[EdgeKey, ...]
    """Edges that only the new path has, in order."""
    notes: tuple[str, ...]
    """What these plans cannot tell about the changes, for a person."""

    @property
    def sentence(self) -> str:
        """The difference in one line."""
        old, new = _said(self.old), _said(self.new)
        if not self.left and not self.joined and self.old.nodes == self.new.nodes:
            return f"The same way: {new} instead of cost {self.old.cost:.2f}." if self.new.nodes else "Still no way."
        return f"{new[0].upper()}{new[1:]}, instead of {old}."


@dataclass(slots=True)
class _World:
    graph: TopologicalGraph
    situation: Situation
    method: Method
    notes: list[str]


def replan(
    graph: TopologicalGraph, situation: Situation, method: Method, changes: Sequence[Change]
) -> Replanned:
    """Plan twice, as it was and as it would be under `changes`, taken in order.

    Costs two copies of the map and two searches. Raises MapError where a change names a node or an edge that is not in
    the map, OptionError for values that cannot be.
    """
    before = _World(graph, situation, method, [])
    after = _World(graph.copy(), situation, method, [])
    for change in changes:
        _impose(after, change)
    old, new = _plan(before), _plan(after)
    old_keys, new_keys = (tuple(itertools.pairwise(path.nodes)) for path in (old, new))
    return Replanned(
        old,
        new,
        tuple(_priced(before, key) for key in old_keys),
        tuple(_priced(after, key) for key in new_keys),
        tuple(key for key in old_keys if key not in new_keys),
        tuple(key for key in new_keys if key not in old_keys),
        tuple(after.notes),
    )


def _plan(world: _World) -> Path:
    source, goal = world.situation.source, world.situation.goal
    if source is None or goal is None:
        missing = "where the robot is" if source is None else "where it should go"
        world.notes.append(f"There is no plan because nobody knows {missing}; set it as a change.")
        return Path((), float("inf"))
    penalty = world.method.planning.failure_penalty
    penalties = {edge: count * penalty for edge, count in world.situation.failures.items()}
    return Planner(world.graph, world.method.planning).plan(source, goal, penalties)


def _priced(world: _World, key: EdgeKey) -> PricedEdge:
    belief, planning = world.graph.edges[key].belief, world.method.planning
    penalty = world.situation.failures.get(key, 0) * planning.failure_penalty
    return PricedEdge(key, belief.mu, edge_cost(belief, planning) - belief.mu, penalty)


def _impose(world: _World, change: Change) -> None:
    match change:
        case EdgeForced(source, target, belief):
            _force(world.graph, (source, target), belief)
        case EdgeBarred(source, target):
            _cut(world.graph, [(source, target)])
        case BeliefSet(source, target, p, mu):
            old = _edge(world.graph, (source, target)).belief
            _believe(world.graph, (source, target), replace(old, p=_or(p, old.p), mu=_or(mu, old.mu)))
        case GoalSet(goal):
            world.situation = replace(world.situation, goal=_node(world.graph, goal))
        case StartSet(source):
            world.situation = replace(world.situation, source=_node(world.graph, source))
        case ThresholdSet(threshold, value):
            _set_threshold(world, threshold, value)


def _force(graph: TopologicalGraph, key: EdgeKey, belief: Belief) -> None:
    if key in graph.edges:
        _believe(graph, key, belief)
    else:  # The plan looks at beliefs alone, so the waypoint does not matter.
        graph.apply(EdgeAdded(Edge(*key, PoseRow(belief.mu, 0.0, 0.0), belief), Cause.HAND))


def _believe(graph: TopologicalGraph, key: EdgeKey, belief: Belief) -> None:
    edge = _edge(graph, key)
    graph.apply(BeliefUpdated(*key, belief, edge.attempts, edge.successes, Cause.HAND))


def _cut(graph: TopologicalGraph, keys: Sequence[EdgeKey]) -> None:
    for key in keys:
        graph.apply(EdgePruned(*key, Cause.HAND))


def _set_threshold(world: _World, threshold: Threshold, value: float) -> None:
    if not 0 <= value < float("inf"):
        raise OptionError(f"{threshold} cannot be {value}; it is a number from 0 upwards.")
    planning = world.method.planning
    match threshold:
        case Threshold.BELIEF_WEIGHT:
            world.method = replace(world.method, planning=replace(planning, belief_weight=value))
        case Threshold.FAILURE_PENALTY:
            world.method = replace(world.method, planning=replace(planning, failure_penalty=value))
        case Threshold.R_P:
            _cut(world.graph, hopeless(world.graph, value, world.method.believing.prune_after_failures))
        case Threshold.D_C:
            _cut(world.graph, [key for key, edge in world.graph.edges.items() if distance(edge.waypoint) >= value])
            if value > world.method.building.connect_distance:
                world.notes.append("A greater D_c makes new edges, which only a rebuild can tell; try the dry run.")
        case Threshold.D_M:
            world.notes.append("D_m decides about nodes, which only a rebuild can tell; try the dry run.")
        case Threshold.D_L:
            _relocalise(world, value)


def _relocalise(world: _World, value: float) -> None:
    look = world.situation.localised
    if look is None:
        world.notes.append("The robot has not looked yet, so D_l changes nothing here.")
    elif look.node is not None and look.distance >= value:
        world.situation = replace(world.situation, source=None)
        world.notes.append(f"With D_l = {value:g} the robot is lost: node {look.node} is {look.distance:.2f} away.")
    elif look.node is None and look.distance < value:
        world.notes.append("With this D_l the robot might not be lost; the recording does not tell at which node.")


def hopeless(graph: TopologicalGraph, prune_below: float, failures: int) -> list[EdgeKey]:
    """Return the edges that maintenance would prune: p < R_p, failed that often, not protected. Linear in edges."""
    return [
        key
        for key, edge in graph.edges.items()
        if edge.belief.p < prune_below and edge.attempts - edge.successes >= failures and not edge.protected
    ]


def _or(value: float | None, old: float) -> float:
    return old if value is None else value


def _edge(graph: TopologicalGraph, key: EdgeKey) -> Edge:
    if key not in graph.edges:
        raise MapError(f"Edge {key[0]} -> {key[1]} is not in the map at this moment; force it in to try it.")
    return graph.edges[key]


def _node(graph: TopologicalGraph, node: NodeId) -> NodeId:
    if node not in graph.nodes:
        raise MapError(f"Node {node} is not in the map at this moment, which has {len(graph.nodes)} nodes.")
    return node


def _said(path: Path) -> str:
    return f"{len(path.nodes)} nodes at cost {path.cost:.2f}" if path.nodes else "no way"
