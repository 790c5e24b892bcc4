"""The planner's problem at one moment, and its plan after hypothetical changes.

Owns the problem (node of the robot, goal, failures of edges), the effect of each change on a copy of the map, and the
comparison of both plans. Map and recording stay unchanged.
"""

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TypeAlias, assert_never

import numpy as np

from ltvn_core.analysis.edge_presence_history import presence_as_if
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import Instant
from ltvn_core.analysis.what_if_changes import (
    WhatIfChange,
    WhatIfThreshold,
    WithBelief,
    WithEdge,
    WithGoal,
    WithoutEdge,
    WithStart,
    WithThreshold,
    WithTime,
)
from ltvn_core.analysis.world_clock import WorldTime, clock_text, time_ahead
from ltvn_core.config import BeliefConfig, Method
from ltvn_core.errors import MapError, OptionError
from ltvn_core.geometry import distance, relative
from ltvn_core.graph.deltas import Belief, BeliefUpdated, Cause, Edge, EdgeAdded, EdgePruned, PoseRow
from ltvn_core.graph.maintenance import should_prune
from ltvn_core.graph.planner import NO_PATH, EdgeWeight, GraphPath, Planner, edge_cost, with_blind_costs
from ltvn_core.graph.presence.presence_filter import PresenceFilter
from ltvn_core.graph.presence.presence_plan import plan_by_presence
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.navigation.events import Localised
from ltvn_core.types import NodeId

_MAX_EDGE_DISTANCE = 5.0
"""Greatest d of a new edge; over a longer distance, the image of the target does not guide the robot."""
EdgeWeightFactory: TypeAlias = Callable[[Method], EdgeWeight]
"""Returns the cost function for edges of a navigation system, for given thresholds."""


@dataclass(frozen=True, slots=True)
class PlannerState:
    """The inputs of the planner at one moment, apart from the map."""

    source: NodeId | None
    """The node at which the robot is localised; None if it was lost or not yet localised."""
    goal: NodeId | None
    """The goal of the query; None if there was no query."""
    failures: Mapping[EdgeKey, int] = field(default_factory=dict)
    """Failures of each edge in this query; each failure costs `PlanningConfig.failure_penalty`."""
    localised: Localised | None = None
    """The localisation that determined `source`."""
    tries: int = 0
    """Number of obstructions met in this query."""


def planner_state_at(timeline: Timeline, instant: Instant | None = None) -> PlannerState:
    """Return the planner's inputs at the end of a step, or of the run without an instant.

    A failed attempt counts against all edges of the plan that it drove, as in the navigator. If the beginning of a
    query is missing, its remaining events are used. Takes logarithmic time.
    """
    progress = timeline.progress_before(timeline.count_until(instant))
    return PlannerState(
        source=progress.localised.node if progress.localised else None,
        goal=progress.goal,
        failures=progress.failures,
        localised=progress.localised,
        tries=progress.obstructions,
    )


def ltvn_edge_weight(method: Method) -> EdgeWeight:
    """Return the cost function for edges of the paper's own system."""
    return partial(edge_cost, config=method.planning)


@dataclass(frozen=True, slots=True)
class PresenceMoment:
    """Presence filter and time, for a planner that uses presence."""

    presence_filter: PresenceFilter
    at_s: float
    """Time of the world, in seconds."""

    def probabilities(self, graph: TopologicalGraph) -> dict[EdgeKey, float]:
        """Return p(open) of all edges that were ever seen blocked, at this time."""
        return presence_as_if(graph, self.presence_filter, self.at_s)


@dataclass(slots=True)
class WhatIfScenario:
    """A map with the planner's inputs and the method at one moment."""

    graph: TopologicalGraph
    planner_state: PlannerState
    method: Method
    edge_weight_of: EdgeWeightFactory = ltvn_edge_weight
    presence: PresenceMoment | None = None
    """Filter and time for p(open) of edges; None if every edge of the map counts as open."""
    notes: list[str] = field(default_factory=list)
    """Limits of the plan, as sentences."""

    @property
    def weight(self) -> EdgeWeight:
        """The cost function for edges."""
        return self.edge_weight_of(self.method)


def apply_what_if_changes(scenario: WhatIfScenario, changes: Sequence[WhatIfChange]) -> WhatIfScenario:
    """Return a copy of a scenario with the changes applied in order.

    Costs one copy of the map; a changed threshold checks every edge. Raises MapError if a change names a node or an
    edge that is not in the map, OptionError for invalid values.
    """
    other = WhatIfScenario(
        graph=scenario.graph.copy(),
        planner_state=scenario.planner_state,
        method=scenario.method,
        edge_weight_of=scenario.edge_weight_of,
        presence=scenario.presence,
    )
    for change in changes:
        _apply_change(other, change)
    return other


def _apply_change(scenario: WhatIfScenario, change: WhatIfChange) -> None:
    match change:
        case WithEdge(source, target, belief):
            _force(scenario, (source, target), belief)
        case WithoutEdge(source, target):
            _cut(scenario.graph, [(source, target)])
        case WithBelief(source, target, p, mu):
            old = _edge(scenario.graph, (source, target)).belief
            _believe(scenario.graph, (source, target), replace(old, p=_or(p, old.p), mu=_or(mu, old.mu)))
        case WithGoal(goal):
            scenario.planner_state = replace(scenario.planner_state, goal=_node(scenario.graph, goal))
        case WithStart(source):
            scenario.planner_state = replace(scenario.planner_state, source=_node(scenario.graph, source))
        case WithThreshold(threshold, value):
            _set_threshold(scenario, threshold, value)
        case WithTime(time):
            _wait(scenario, time)
        case _:
            assert_never(change)


def _wait(scenario: WhatIfScenario, time: WorldTime) -> None:
    if scenario.presence is None or not scenario.graph.presence:
        scenario.notes.append("No edge was ever seen blocked here, so time changes nothing.")
        return
    at_s = time_ahead(time, scenario.presence.at_s)
    scenario.presence = replace(scenario.presence, at_s=at_s)
    # A later departure would start another query.
    scenario.planner_state = replace(scenario.planner_state, tries=0, failures={})
    scenario.notes.append(f"It would be {clock_text(at_s)}, without new observations until then.")


def _weighs_belief(edge_weight_of: EdgeWeightFactory, method: Method) -> bool:
    """Tell whether a system's edge costs depend on the belief weight."""
    doubtful = Belief(p=0.5, mu=1.0, sigma2=0.0)
    planning = (replace(method.planning, belief_weight=weight) for weight in (1.0, 2.0))
    less, more = (edge_weight_of(replace(method, planning=each))(doubtful) for each in planning)
    return less != more


def _force(scenario: WhatIfScenario, key: EdgeKey, belief: Belief | None) -> None:
    graph = scenario.graph
    if key in graph.edges:
        if belief is not None:
            _believe(graph, key, belief)
    elif belief is None:
        _force(scenario, key, _fresh_belief(graph, key, scenario.method.believing))
    else:  # The planner uses only beliefs, so the waypoint does not matter.
        graph.apply(EdgeAdded(Edge(*key, PoseRow(belief.mu, 0.0, 0.0), belief), Cause.HAND))


def _fresh_belief(graph: TopologicalGraph, key: EdgeKey, config: BeliefConfig) -> Belief:
    """Return the belief of a new edge: the highest p that the method allows, and the length by odometry."""
    ends = [np.array(graph.nodes[_node(graph, node)].odometry) for node in key]
    if key[0] == key[1]:
        raise MapError(f"Edge {key[0]} -> {key[1]} cannot be added: a node has no edge to itself.")
    length = float(distance(relative(*ends)))
    if not length <= _MAX_EDGE_DISTANCE:
        raise OptionError(
            f"Edge {key[0]} -> {key[1]} would be {length:.1f} long; an edge joins places in sight of each other, at "
            f"most {_MAX_EDGE_DISTANCE:g} apart. Choose nearer nodes or join them through others."
        )
    return Belief(config.p_cap, length, config.sigma2)


def _believe(graph: TopologicalGraph, key: EdgeKey, belief: Belief) -> None:
    edge = _edge(graph, key)
    graph.apply(
        BeliefUpdated(
            source=edge.source,
            target=edge.target,
            belief=belief,
            attempts=edge.attempts,
            successes=edge.successes,
            cause=Cause.HAND,
        )
    )


def _cut(graph: TopologicalGraph, keys: Sequence[EdgeKey]) -> None:
    for source, target in keys:
        graph.apply(EdgePruned(source, target, Cause.HAND))


def _set_threshold(scenario: WhatIfScenario, threshold: WhatIfThreshold, value: float) -> None:
    if not 0 <= value < float("inf"):
        raise OptionError(f"{threshold} cannot be {value}; it must be a number of at least 0.")
    planning = scenario.method.planning
    match threshold:
        case WhatIfThreshold.BELIEF_WEIGHT:
            scenario.method = replace(scenario.method, planning=replace(planning, belief_weight=value))
            if not _weighs_belief(scenario.edge_weight_of, scenario.method):
                scenario.notes.append(
                    "The system of this run does not use it for the cost of edges, so nothing changes."
                )
        case WhatIfThreshold.FAILURE_PENALTY:
            scenario.method = replace(scenario.method, planning=replace(planning, failure_penalty=value))
        case WhatIfThreshold.R_P:
            _cut(scenario.graph, _prunable(scenario.graph, value, scenario.method.believing))
        case WhatIfThreshold.D_C:
            _cut(scenario.graph, _longer(scenario.graph, value))
            if value > scenario.method.building.connect_distance:
                scenario.notes.append("A greater D_c makes new edges only when the map is built again.")
        case WhatIfThreshold.D_L:
            _relocalise(scenario, value)


def _relocalise(scenario: WhatIfScenario, value: float) -> None:
    look = scenario.planner_state.localised
    if look is None:
        scenario.notes.append("The robot has not looked yet, so D_l changes nothing here.")
    elif look.node is not None and look.distance >= value:
        scenario.planner_state = replace(scenario.planner_state, source=None)
        scenario.notes.append(f"With D_l = {value:g} the robot is lost: node {look.node} is {look.distance:.2f} away.")
    elif look.node is None and look.distance < value:
        scenario.notes.append(
            "With this D_l the robot might not be lost; the recording does not say at which node it is."
        )


def _prunable(graph: TopologicalGraph, prune_below: float, config: BeliefConfig) -> list[EdgeKey]:
    return [key for key, edge in graph.edges.items() if should_prune(edge, prune_below, config)]


def _longer(graph: TopologicalGraph, length: float) -> list[EdgeKey]:
    driven = graph.driven_edges
    waypoints = np.array([edge.waypoint for edge in driven.values()]).reshape(-1, 3)
    return [key for key, long in zip(driven, distance(waypoints) >= length, strict=True) if long]


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


@dataclass(frozen=True, slots=True)
class EdgeCostParts:
    """Cost of one edge of a path, part by part."""

    edge: EdgeKey
    mu: float
    """Expected length by the belief."""
    doubt: float
    """Part of the cost from p: -weight * ln p in the paper's system."""
    penalty: float
    """Penalty for failures earlier in the query, and for missing support by images while the place is unsure."""
    open_p: float = 1.0
    """p(open) of the edge at this time."""


@dataclass(frozen=True, slots=True)
class PlanDifference:
    """Comparison of two plans."""

    old: GraphPath
    new: GraphPath
    old_edges: tuple[EdgeCostParts, ...]
    """Costs of the edges along the old path."""
    new_edges: tuple[EdgeCostParts, ...]
    """Costs of the edges along the new path, after the changes."""
    removed_edges: tuple[EdgeKey, ...]
    """Edges that only the old path has, in order."""
    added_edges: tuple[EdgeKey, ...]
    """Edges that only the new path has, in order."""
    notes: tuple[str, ...]
    """Limits of the plans, as sentences."""
    old_open: Mapping[EdgeKey, float] = field(default_factory=dict)
    """p(open) before the changes, of each edge that was ever seen blocked."""
    new_open: Mapping[EdgeKey, float] = field(default_factory=dict)
    """p(open) of the same edges after the changes."""

    @property
    def sentence(self) -> str:
        """The difference as one sentence."""
        old = _path_text(self.old)
        new = _path_text(self.new)
        if self.old.nodes != self.new.nodes:
            return f"{new[0].upper()}{new[1:]}, instead of {old}."
        if not self.new.nodes:
            return "Still no way."
        same = math.isclose(self.old.cost, self.new.cost)
        return f"The same path, {new}." if same else f"The same path, {new} instead of {self.old.cost:.2f}."


def replan(
    graph: TopologicalGraph,
    planner_state: PlannerState,
    method: Method,
    changes: Sequence[WhatIfChange],
    *,
    edge_weight_of: EdgeWeightFactory = ltvn_edge_weight,
    presence: PresenceMoment | None = None,
) -> PlanDifference:
    """Plan twice: without the changes, and with the changes applied in order.

    `edge_weight_of` gives the edge costs of the system that planned; by default the paper's own. With `presence`, both
    plans use p(open) of the edges. Costs two copies of the map and two searches. Raises MapError if a change names a
    node or an edge that is not in the map, OptionError for invalid values.
    """
    before = WhatIfScenario(
        graph=graph,
        planner_state=planner_state,
        method=method,
        edge_weight_of=edge_weight_of,
        presence=presence,
    )
    after = apply_what_if_changes(before, changes)
    old_open = _open_edges(before)
    new_open = _open_edges(after)
    old = _plan(before, old_open)
    new = _plan(after, new_open)
    old_keys, new_keys = (tuple(itertools.pairwise(path.nodes)) for path in (old, new))
    return PlanDifference(
        old=old,
        new=new,
        old_edges=tuple(_cost_parts(before, old_keys, old_open)),
        new_edges=tuple(_cost_parts(after, new_keys, new_open)),
        removed_edges=tuple(key for key in old_keys if key not in new_keys),
        added_edges=tuple(key for key in new_keys if key not in old_keys),
        notes=tuple(after.notes),
        old_open=old_open,
        new_open=new_open,
    )


def _open_edges(scenario: WhatIfScenario) -> Mapping[EdgeKey, float]:
    return {} if scenario.presence is None else scenario.presence.probabilities(scenario.graph)


def _plan(scenario: WhatIfScenario, open_edges: Mapping[EdgeKey, float]) -> GraphPath:
    source = scenario.planner_state.source
    goal = scenario.planner_state.goal
    if source is None or goal is None:
        missing = "where the robot is" if source is None else "where it should go"
        scenario.notes.append(f"There is no plan because the recording does not say {missing}; set it as a change.")
        return NO_PATH
    planning = scenario.method.planning
    asked = scenario.planner_state
    planner = Planner(scenario.graph, planning, weight=scenario.weight)
    return plan_by_presence(
        planner, source, goal, _penalties(scenario), open_edges, belief_weight=planning.belief_weight, tries=asked.tries
    )


def _penalties(scenario: WhatIfScenario) -> Mapping[EdgeKey, float]:
    asked = scenario.planner_state
    failures = {edge: count * scenario.method.planning.failure_penalty for edge, count in asked.failures.items()}
    place_p = None if asked.localised is None else asked.localised.probability
    return with_blind_costs(scenario.graph, failures, place_p)


def _cost_parts(
    scenario: WhatIfScenario, keys: Sequence[EdgeKey], open_edges: Mapping[EdgeKey, float]
) -> Iterator[EdgeCostParts]:
    penalties = _penalties(scenario)
    for key in keys:
        belief = scenario.graph.edges[key].belief
        doubt = scenario.weight(belief) - belief.mu
        penalty = penalties.get(key, 0.0)
        yield EdgeCostParts(edge=key, mu=belief.mu, doubt=doubt, penalty=penalty, open_p=open_edges.get(key, 1.0))


def _path_text(path: GraphPath) -> str:
    return f"{len(path.nodes)} nodes at cost {path.cost:.2f}" if path.nodes else "no way"
