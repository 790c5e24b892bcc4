"""The planner's problem at one moment of a run, and its plan: as it was, or after imagined changes.

Owns the problem (map, place of the robot, goal, failures of edges), the effect of each change on a copy of it, and the
comparison of two plans. What would have been, and why a plan was made, are both answered by `replan`. Map and recording
stay unchanged.
"""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import NamedTuple, TypeAlias, assert_never

import numpy as np

from ltvn_core.analysis.presence_forecast import presence_as_if
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import Instant, PlanRecord
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
from ltvn_core.analysis.world_clock import clock_text, latest_known_time, time_ahead, world_time_at, world_time_before
from ltvn_core.config import BeliefConfig, Method
from ltvn_core.errors import MapError, OptionError
from ltvn_core.geometry import distance, relative
from ltvn_core.graph.deltas import Belief, BeliefUpdated, Cause, Edge, EdgeAdded, EdgePruned, PoseRow
from ltvn_core.graph.operators import should_prune
from ltvn_core.graph.planner import NO_PATH, EdgeWeight, GraphPath, Planner, edge_cost, with_blind_costs
from ltvn_core.graph.presence.edge_presence import plan_by_presence
from ltvn_core.graph.presence.presence_filter import PresenceFilter
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.navigation.events import Localised
from ltvn_core.types import NodeId

_MAX_EDGE_DISTANCE = 5.0
"""Greatest d of a new edge; over a longer distance, the image of the target does not guide the robot."""
EdgeWeightFactory: TypeAlias = Callable[[Method], EdgeWeight]
"""Returns the cost function for edges of a navigation system, for given thresholds."""


def ltvn_edge_weight(method: Method) -> EdgeWeight:
    """Return the cost function for edges of the paper's own system."""
    return partial(edge_cost, config=method.planning)


class Rules(NamedTuple):
    """The rules by which a run plans."""

    method: Method
    edge_weight_of: EdgeWeightFactory = ltvn_edge_weight
    """Edge costs of the system that plans."""
    presence_filter: PresenceFilter | None = None
    """Filter for p(open) of edges; None if every edge of the map counts as open."""


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """What the planner has to solve at one moment."""

    graph: TopologicalGraph
    source: NodeId | None = None
    """The node at which the robot is localised; None if it was lost or not yet localised."""
    goal: NodeId | None = None
    """The goal of the query; None if there was no query."""
    failures: Mapping[EdgeKey, int] = field(default_factory=dict)
    """Failures of each edge in this query; each failure costs `PlanningConfig.failure_penalty`."""
    localised: Localised | None = None
    """The localisation that determined `source`."""
    place_p: float | None = None
    """Probability of the robot's likeliest place; None if unknown."""
    tries: int = 0
    """Number of obstructions met in this query."""
    at_s: float = 0.0
    """Time of the world, in seconds."""
    notes: tuple[str, ...] = ()
    """Limits of a plan for this moment, as sentences."""

    def penalties(self, rules: Rules) -> Mapping[EdgeKey, float]:
        """Return the extra costs of edges for failures, and for missing support by images while the place is unsure."""
        penalty = rules.method.planning.failure_penalty
        failures = {edge: count * penalty for edge, count in self.failures.items()}
        return with_blind_costs(self.graph, failures, self.place_p)

    def open_edges(self, rules: Rules) -> Mapping[EdgeKey, float]:
        """Return p(open) of all edges that were ever seen blocked; nothing if the rules ignore presence."""
        return {} if rules.presence_filter is None else presence_as_if(self.graph, rules.presence_filter, self.at_s)


def moment_at(timeline: Timeline, instant: Instant | None = None, graph: TopologicalGraph | None = None) -> Moment:
    """Return the planner's problem at the end of a step, or of the run without an instant.

    A failed attempt counts against all edges of the plan that it drove, as in the navigator. If the beginning of a
    query is missing, its remaining events are used. Costs as much as `Timeline.graph_at`, unless that map is given.
    """
    count = timeline.count_until(instant)
    progress = timeline.progress_before(count)
    graph = timeline.graph_before(count) if graph is None else graph
    now_s = 0.0
    if graph.presence:  # Without it nothing depends on the time, which is found by walking back over the events.
        now_s = world_time_before(timeline, count) if instant is None else world_time_at(timeline, instant)
    localised = progress.localised
    return Moment(
        graph=graph,
        source=localised.node if localised else None,
        goal=progress.goal,
        failures=progress.failures,
        localised=localised,
        place_p=localised.probability if localised else None,
        tries=progress.obstructions,
        at_s=latest_known_time(graph, now_s),
    )


def moment_of_plan(timeline: Timeline, plan: PlanRecord) -> Moment:
    """Return the planner's problem of a recorded plan with a path; costs as much as `Timeline.graph_at`."""
    progress = timeline.progress_before(plan.event)
    graph = timeline.graph_before(plan.event)
    return Moment(
        graph=graph,
        source=plan.planned.nodes[0],
        goal=plan.planned.nodes[-1],
        failures={} if progress.query is None else progress.failures,
        place_p=plan.place_p,
        tries=progress.obstructions,
        at_s=latest_known_time(graph, world_time_at(timeline, plan.instant)),
    )


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


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """A plan, and the problem that it solves."""

    moment: Moment
    path: GraphPath
    edges: tuple[EdgeCostParts, ...]
    """Costs of the edges along the path."""
    open_edges: Mapping[EdgeKey, float]
    """p(open) of each edge that was ever seen blocked."""
    notes: tuple[str, ...]
    """Limits of the plan, as sentences."""

    @property
    def text(self) -> str:
        """The path in a few words."""
        return f"{len(self.path.nodes)} nodes at cost {self.path.cost:.2f}" if self.path.nodes else "no way"


def replan(moment: Moment, changes: Sequence[WhatIfChange], rules: Rules) -> Plan:
    """Plan at a moment by the given rules, with the changes applied in order.

    Changes cost one copy of the map, and a changed threshold checks every edge. Raises MapError if a change names a
    node or an edge that is not in the map, OptionError for invalid values.
    """
    moment, rules = imagine(moment, changes, rules)
    open_edges = moment.open_edges(rules)
    if moment.source is None or moment.goal is None:
        missing = "where the robot is" if moment.source is None else "where it should go"
        note = f"There is no plan because the recording does not say {missing}; set it as a change."
        return Plan(moment, NO_PATH, (), open_edges, (*moment.notes, note))
    planning = rules.method.planning
    weight = rules.edge_weight_of(rules.method)
    penalties = moment.penalties(rules)
    path = plan_by_presence(
        Planner(moment.graph, planning, weight=weight),
        *(moment.source, moment.goal, penalties, open_edges),
        belief_weight=planning.belief_weight,
        tries=moment.tries,
    )
    edges = []
    for key in itertools.pairwise(path.nodes):
        belief = moment.graph.edges[key].belief
        doubt = weight(belief) - belief.mu
        edges.append(EdgeCostParts(key, belief.mu, doubt, penalties.get(key, 0.0), open_edges.get(key, 1.0)))
    return Plan(moment, path, tuple(edges), open_edges, moment.notes)


@dataclass(frozen=True, slots=True, eq=False)
class PlanDifference:
    """Comparison of two plans."""

    old: Plan
    new: Plan

    @property
    def removed_edges(self) -> tuple[EdgeKey, ...]:
        """Edges that only the old path has, in order."""
        kept = {part.edge for part in self.new.edges}
        return tuple(part.edge for part in self.old.edges if part.edge not in kept)

    @property
    def added_edges(self) -> tuple[EdgeKey, ...]:
        """Edges that only the new path has, in order."""
        known = {part.edge for part in self.old.edges}
        return tuple(part.edge for part in self.new.edges if part.edge not in known)

    @property
    def sentence(self) -> str:
        """The difference as one sentence."""
        old, new = self.old.path, self.new.path
        if old.nodes != new.nodes:
            return f"{self.new.text[0].upper()}{self.new.text[1:]}, instead of {self.old.text}."
        if not new.nodes:
            return "Still no way."
        same = math.isclose(old.cost, new.cost)
        return (
            f"The same path, {self.new.text}." if same else f"The same path, {self.new.text} instead of {old.cost:.2f}."
        )


def imagine(moment: Moment, changes: Sequence[WhatIfChange], rules: Rules) -> tuple[Moment, Rules]:
    """Return the problem and the rules with the changes applied in order; raises the errors of `replan`."""
    moment = replace(moment, graph=moment.graph.copy()) if changes else moment
    for change in changes:
        moment, rules = _after(moment, change, rules)
    return moment, rules


def _after(moment: Moment, change: WhatIfChange, rules: Rules) -> tuple[Moment, Rules]:
    """Apply a change; the map is changed in place."""
    graph = moment.graph
    match change:
        case WithEdge(source, target, belief) if (source, target) not in graph.edges:
            belief = _fresh_belief(graph, (source, target), rules.method.believing) if belief is None else belief
            # The planner uses only beliefs, so the waypoint does not matter.
            graph.apply(EdgeAdded(Edge(source, target, PoseRow(belief.mu, 0.0, 0.0), belief), Cause.HAND))
        case WithEdge(source, target, belief):
            if belief is not None:
                _believe(graph, (source, target), belief)
        case WithoutEdge(source, target):
            graph.apply(EdgePruned(source, target, Cause.HAND))
        case WithBelief(source, target, p, mu):
            old = _edge(graph, (source, target)).belief
            p, mu = (before if wanted is None else wanted for wanted, before in ((p, old.p), (mu, old.mu)))
            _believe(graph, (source, target), replace(old, p=p, mu=mu))
        case WithGoal(goal):
            moment = replace(moment, goal=_node(graph, goal))
        case WithStart(source):
            moment = replace(moment, source=_node(graph, source))
        case WithThreshold(threshold, value):
            return _with_threshold(moment, threshold, value, rules)
        case WithTime() if rules.presence_filter is None or not graph.presence:
            return _noted(moment, "No edge was ever seen blocked here, so time changes nothing."), rules
        case WithTime(time):
            at_s = time_ahead(time, moment.at_s)
            # A later departure would start another query.
            later = replace(moment, at_s=at_s, tries=0, failures={})
            return _noted(later, f"It would be {clock_text(at_s)}, without new observations until then."), rules
        case _:
            assert_never(change)
    return moment, rules


def _noted(moment: Moment, note: str) -> Moment:
    return replace(moment, notes=(*moment.notes, note))


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


def _with_threshold(moment: Moment, threshold: WhatIfThreshold, value: float, rules: Rules) -> tuple[Moment, Rules]:
    if not 0 <= value < float("inf"):
        raise OptionError(f"{threshold} cannot be {value}; it must be a number of at least 0.")
    graph, method = moment.graph, rules.method
    match threshold:
        case WhatIfThreshold.BELIEF_WEIGHT:
            # Whether the costs of a system depend on the belief weight shows on any doubtful belief.
            planning = (replace(method.planning, belief_weight=weight) for weight in (1.0, 2.0))
            doubtful = Belief(p=0.5, mu=1.0, sigma2=0.0)
            less, more = (rules.edge_weight_of(replace(method, planning=each))(doubtful) for each in planning)
            if less == more:
                note = "The system of this run does not use it for the cost of edges, so nothing changes."
                moment = _noted(moment, note)
            rules = rules._replace(method=replace(method, planning=replace(method.planning, belief_weight=value)))
        case WhatIfThreshold.FAILURE_PENALTY:
            rules = rules._replace(method=replace(method, planning=replace(method.planning, failure_penalty=value)))
        case WhatIfThreshold.R_P:
            edges = graph.edges.items()
            _cut(graph, [key for key, edge in edges if should_prune(edge, value, method.believing)])
        case WhatIfThreshold.D_C:
            driven = graph.driven_edges
            waypoints = np.array([edge.waypoint for edge in driven.values()]).reshape(-1, 3)
            _cut(graph, [key for key, long in zip(driven, distance(waypoints) >= value, strict=True) if long])
            if value > method.building.connect_distance:
                moment = _noted(moment, "A greater D_c makes new edges only when the map is built again.")
        case WhatIfThreshold.D_L:
            moment = _relocalised(moment, value)
    return moment, rules


def _relocalised(moment: Moment, value: float) -> Moment:
    look = moment.localised
    if look is None:
        return _noted(moment, "The robot has not looked yet, so D_l changes nothing here.")
    if look.node is not None and look.distance >= value:
        note = f"With D_l = {value:g} the robot is lost: node {look.node} is {look.distance:.2f} away."
        return _noted(replace(moment, source=None), note)
    if look.node is None and look.distance < value:
        note = "With this D_l the robot might not be lost; the recording does not say at which node it is."
        return _noted(moment, note)
    return moment


def _cut(graph: TopologicalGraph, keys: Sequence[EdgeKey]) -> None:
    for source, target in keys:
        graph.apply(EdgePruned(source, target, Cause.HAND))


def _edge(graph: TopologicalGraph, key: EdgeKey) -> Edge:
    if key not in graph.edges:
        raise MapError(f"Edge {key[0]} -> {key[1]} is not in the map at this moment; force it in to try it.")
    return graph.edges[key]


def _node(graph: TopologicalGraph, node: NodeId) -> NodeId:
    if node not in graph.nodes:
        raise MapError(f"Node {node} is not in the map at this moment, which has {len(graph.nodes)} nodes.")
    return node
