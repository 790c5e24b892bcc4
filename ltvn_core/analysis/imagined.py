"""A moment of a query as it was, or as somebody imagines it: the map, the question and the thresholds.

Owns what each imagined change does to a copy. Does not plan (`analysis.what_if`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TypeAlias

import numpy as np

from ltvn_core.analysis.changes import (
    BeliefSet,
    Change,
    EdgeBarred,
    EdgeForced,
    GoalSet,
    StartSet,
    Threshold,
    ThresholdSet,
)
from ltvn_core.analysis.situation import Situation
from ltvn_core.config import Believing, Method
from ltvn_core.errors import MapError, OptionError
from ltvn_core.geometry import distance
from ltvn_core.graph.deltas import Belief, BeliefUpdated, Cause, Edge, EdgeAdded, EdgePruned, PoseRow
from ltvn_core.graph.maintenance import is_hopeless
from ltvn_core.graph.planner import EdgeWeight, edge_cost
from ltvn_core.graph.topograph import EdgeKey, TopologicalGraph
from ltvn_core.types import NodeId

Weights: TypeAlias = Callable[[Method], EdgeWeight]
"""How a navigation system weighs edges, given the thresholds."""


def ltvn_weights(method: Method) -> EdgeWeight:
    """Weigh edges as the paper's own system does."""
    return partial(edge_cost, config=method.planning)


@dataclass(slots=True)
class World:
    """A map with the question and the thresholds of one moment."""

    graph: TopologicalGraph
    situation: Situation
    method: Method
    weights: Weights = ltvn_weights
    notes: list[str] = field(default_factory=list)
    """What a plan in this world cannot tell, for a person."""

    @property
    def weight(self) -> EdgeWeight:
        """What an edge costs here."""
        return self.weights(self.method)


def imagine(world: World, changes: Sequence[Change]) -> World:
    """Return a copy of the world with the changes in it, taken in order; `world` stays as it was.

    Costs one copy of the map; a threshold looks at every edge. Raises MapError where a change names a node or an edge
    that is not in the map, OptionError for values that cannot be.
    """
    other = World(world.graph.copy(), world.situation, world.method, world.weights)
    for change in changes:
        _impose(other, change)
    return other


def _impose(world: World, change: Change) -> None:
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


def _set_threshold(world: World, threshold: Threshold, value: float) -> None:
    if not 0 <= value < float("inf"):
        raise OptionError(f"{threshold} cannot be {value}; it is a number from 0 upwards.")
    planning = world.method.planning
    match threshold:
        case Threshold.BELIEF_WEIGHT:
            world.method = replace(world.method, planning=replace(planning, belief_weight=value))
            if world.weights is not ltvn_weights:
                world.notes.append("The system that planned here weighs edges without it, so nothing changes.")
        case Threshold.FAILURE_PENALTY:
            world.method = replace(world.method, planning=replace(planning, failure_penalty=value))
        case Threshold.R_P:
            _cut(world.graph, hopeless(world.graph, value, world.method.believing))
        case Threshold.D_C:
            _cut(world.graph, _longer(world.graph, value))
            if value > world.method.building.connect_distance:
                world.notes.append("A greater D_c makes new edges, which only a rebuild can tell; try the dry run.")
        case Threshold.D_M:
            world.notes.append("D_m decides about nodes, which only a rebuild can tell; try the dry run.")
        case Threshold.D_L:
            _relocalise(world, value)


def _relocalise(world: World, value: float) -> None:
    look = world.situation.localised
    if look is None:
        world.notes.append("The robot has not looked yet, so D_l changes nothing here.")
    elif look.node is not None and look.distance >= value:
        world.situation = replace(world.situation, source=None)
        world.notes.append(f"With D_l = {value:g} the robot is lost: node {look.node} is {look.distance:.2f} away.")
    elif look.node is None and look.distance < value:
        world.notes.append("With this D_l the robot might not be lost; the recording does not tell at which node.")


def hopeless(graph: TopologicalGraph, prune_below: float, config: Believing) -> list[EdgeKey]:
    """Return the edges that maintenance would prune with this R_p. Linear in edges."""
    return [key for key, edge in graph.edges.items() if is_hopeless(edge, prune_below, config)]


def _longer(graph: TopologicalGraph, length: float) -> list[EdgeKey]:
    waypoints = np.array([edge.waypoint for edge in graph.edges.values()]).reshape(-1, 3)
    return [key for key, long in zip(graph.edges, distance(waypoints) >= length, strict=True) if long]


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
