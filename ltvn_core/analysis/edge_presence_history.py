"""When an edge was open and closed, the prediction for it, and why a plan used or avoided an edge that was seen
blocked.

Computes this from observations, for one edge or for the whole map at a moment. Also explains a plan by the rule of
`graph.presence.presence_plan`; for that it plans again on the map at that time. Does not change the recording.
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from math import inf, isfinite, log
from typing import TypeAlias

import numpy as np

from ltvn_core.analysis.plan_alternative import failure_penalties_at
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import Instant, PlanRecord
from ltvn_core.analysis.world_clock import clock_text, duration_text, latest_known_time, world_time_at
from ltvn_core.config import PlanningConfig
from ltvn_core.graph.deltas import Cause, PresenceObserved
from ltvn_core.graph.planner import EdgeWeight, GraphPath, Planner, with_blind_costs
from ltvn_core.graph.presence.presence_filter import (
    PresenceFilter,
    PresenceObservation,
    follow_histories,
    presence_probabilities,
)
from ltvn_core.graph.presence.presence_plan import HOPELESS_BELOW, OPEN_ABOVE, plan_by_presence
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph
from ltvn_core.types import NodeId

_LONGEST_S = 14 * 86400.0
"""Longest time ahead, in seconds, in which an edge is predicted to open again."""


class PresenceState(StrEnum):
    """Predicted presence of an edge at one moment."""

    OPEN = "open"
    CLOSED = "closed"
    UNKNOWN = "unknown"
    """The edge was closed, and may be open again."""


@dataclass(frozen=True, slots=True)
class ObservedPresence:
    """One observation of an edge, and its moment in the recording."""

    instant: Instant
    observation: PresenceObservation
    cause: Cause
    attempt: int | None
    """The attempt in which the edge was observed; None if it was seen from a distance or came with the map."""


@dataclass(frozen=True, slots=True)
class PresenceStrip:
    """The probability that an edge is open, at several times."""

    times_s: tuple[float, ...]
    """Times of the world, in seconds."""
    probabilities: tuple[float, ...]

    @property
    def states(self) -> tuple[PresenceState, ...]:
        """The predicted presence at each time."""
        return tuple(presence_state(p) for p in self.probabilities)


def presence_state(p: float) -> PresenceState:
    """Return how the planner treats an edge that is open with probability `p`."""
    if p >= OPEN_ABOVE:
        return PresenceState.OPEN
    return PresenceState.CLOSED if p < HOPELESS_BELOW else PresenceState.UNKNOWN


def observed_presence(
    timeline: Timeline, source: NodeId, target: NodeId, until: Instant | None = None
) -> tuple[ObservedPresence, ...]:
    """Return the observations of an edge up to an instant, oldest first; linear in the changes of the edge."""
    count = timeline.count_until(until)
    return tuple(
        ObservedPresence(
            instant=change.instant,
            observation=PresenceObservation(change.delta.present, change.delta.stamp),
            cause=change.delta.cause,
            attempt=change.attempt,
        )
        for change in timeline.changes_of_edge(source, target)
        if change.event < count and isinstance(change.delta, PresenceObserved)
    )


def presence_strip(
    observations: Sequence[PresenceObservation], presence_filter: PresenceFilter, times_s: Sequence[float]
) -> PresenceStrip:
    """Return p(open) of an edge at ascending times, each from the observations before that time.

    Times after the last observation are predictions. Linear in observations and times.
    """
    tracks = presence_filter.follow(1)
    row = np.zeros(1, np.intp)
    found = []
    next_look = 0
    for at_s in times_s:
        while next_look < len(observations) and observations[next_look].stamp_s <= at_s:
            seen = observations[next_look]
            tracks.observe(row, np.array([seen.present]), np.array([seen.stamp_s]))
            next_look += 1
        found.append(float(tracks.probability(at_s)[0]))
    return PresenceStrip(tuple(times_s), tuple(found))


def expected_open_s(
    observations: Sequence[PresenceObservation], presence_filter: PresenceFilter, now_s: float
) -> float | None:
    """Return the time at which a closed edge will count as open if nothing more is observed, in seconds; None if it
    counts as open now, or will not within two weeks."""
    tracks = follow_histories(presence_filter, [[seen for seen in observations if seen.stamp_s <= now_s]])
    if tracks.probability(now_s)[0] >= OPEN_ABOVE:
        return None
    ahead_s = np.geomspace(1.0, _LONGEST_S, 200)
    for later_s in ahead_s:
        if tracks.probability(now_s + float(later_s))[0] >= OPEN_ABOVE:
            return now_s + float(later_s)
    return None


def presence_as_if(graph: TopologicalGraph, presence_filter: PresenceFilter, at_s: float) -> dict[EdgeKey, float]:
    """Return p(open) at a time for all edges that were ever seen blocked, from the observations in the map.

    For a time in the past, only earlier observations count.
    """
    histories = list(graph.presence.values())
    found = presence_probabilities(presence_filter, histories, at_s)
    return dict(zip(graph.presence, map(float, found), strict=True))


@dataclass(frozen=True, slots=True)
class PresenceChange:
    """An edge whose state of presence differs between two maps or times, with p(open) of each."""

    edge: EdgeKey
    before: float
    now: float


MapAtTime: TypeAlias = tuple[TopologicalGraph, float]
"""A map, and a time of its world in seconds."""


def presence_difference(
    here: MapAtTime, there: MapAtTime, presence_filter: PresenceFilter, *, edges: Mapping[EdgeKey, EdgeKey]
) -> tuple[PresenceChange, ...]:
    """Return the edges with a different state of presence in two maps, by their names in the map `here`.

    `edges` maps the common edges from the map `here` to the map `there`. Edges that were never seen blocked are open.
    """
    now, before = (presence_as_if(graph, presence_filter, at_s) for graph, at_s in (here, there))
    known = {edge: other for edge, other in edges.items() if edge in now or other in before}
    changes = (PresenceChange(edge, before.get(other, 1.0), now.get(edge, 1.0)) for edge, other in known.items())
    return tuple(each for each in changes if presence_state(each.before) is not presence_state(each.now))


@dataclass(frozen=True, slots=True)
class PresenceDecision:
    """One choice between a path through edges that counted as closed and the cheapest detour."""

    plan: PlanRecord
    """The recorded plan."""
    at_s: float
    """Time of the decision, in seconds of the world."""
    edge: EdgeKey
    """The edge with the least p(open) on the path through closed edges."""
    p: float
    """p(open) of this edge at that time."""
    seen_s: float | None
    """Time when the edge was last seen blocked, in seconds of the world; None without such an observation."""
    through: GraphPath
    """The cheapest path if the closed edges were open."""
    around: GraphPath
    """The cheapest path without the closed edges; empty if there is none."""
    to_edge_cost: float
    """Cost of the plan from the start to the first closed edge."""
    back_cost: float
    """Cost from that edge to the goal without closed edges; infinite if there is no path."""
    tries: int
    """Number of obstructions met earlier in this query."""
    follows_rule: bool
    """Whether planning again by the rule gives the recorded plan."""

    @property
    def expected_cost(self) -> float:
        """Expected cost of a try: through the edge if it is open, else to the edge and around it."""
        return self.p * self.through.cost + (1 - self.p) * (self.to_edge_cost + self.back_cost)

    @property
    def expected_saving(self) -> float:
        """Expected saving of a try compared with the detour; negative if a try is not worthwhile."""
        return self.around.cost - self.expected_cost

    @property
    def counts_as_open(self) -> bool:
        """Whether the edge was probably open, so that the plan could use it like any other at a slightly higher
        cost."""
        return self.p >= OPEN_ABOVE

    @property
    def tried(self) -> bool:
        """Whether the recorded plan leads through the edge."""
        return self.edge in self.plan.edges


def presence_decision(
    timeline: Timeline,
    plan: PlanRecord,
    planning: PlanningConfig,
    presence_filter: PresenceFilter,
    *,
    weight: EdgeWeight | None = None,
) -> PresenceDecision | None:
    """Return the two alternatives of a plan; None if its shortest path has no edge that was last seen blocked.

    `planning`, `weight` and `presence_filter` are those of the run. Linear in the changes of the map; plans five times.
    """
    graph = timeline.graph_before(plan.event)
    if not graph.presence or not plan.planned.nodes:
        return None
    at_s = latest_known_time(graph, world_time_at(timeline, plan.instant))
    open_now = presence_as_if(graph, presence_filter, at_s)
    closed = [edge for edge, p in open_now.items() if p < OPEN_ABOVE]
    penalties = with_blind_costs(graph, failure_penalties_at(timeline, plan.event, planning), plan.place_p)
    doubts = {edge: -planning.belief_weight * log(p) for edge, p in open_now.items() if p >= OPEN_ABOVE}
    costs = {edge: penalties.get(edge, 0.0) + doubts.get(edge, 0.0) for edge in penalties.keys() | doubts.keys()}
    planner = Planner(graph, planning, weight=weight)
    start = plan.planned.nodes[0]
    goal = plan.planned.nodes[-1]
    through = planner.plan(start, goal, costs)
    on_way = list(itertools.pairwise(through.nodes))
    passed = [edge for edge in on_way if edge in closed]
    # An edge that was last seen blocked may count as open by now, and be tried like any other edge.
    passed = passed or [edge for edge in on_way if edge in open_now and not graph.presence[edge][-1].present]
    if not passed:
        return None
    without = costs | dict.fromkeys([*closed, *passed], inf)
    edge = min(passed, key=open_now.__getitem__)
    tries = timeline.progress_before(plan.event).obstructions
    by_rule = plan_by_presence(
        planner, start, goal, penalties, open_now, belief_weight=planning.belief_weight, tries=tries
    )
    return PresenceDecision(
        plan=plan,
        at_s=at_s,
        edge=edge,
        p=open_now[edge],
        seen_s=last_seen_blocked(graph, edge, at_s),
        through=through,
        around=planner.plan(start, goal, without),
        to_edge_cost=planner.plan(start, passed[0][0], costs).cost,
        back_cost=planner.plan(passed[0][0], goal, without).cost,
        tries=tries,
        follows_rule=by_rule.nodes == plan.planned.nodes,
    )


def last_seen_blocked(graph: TopologicalGraph, edge: EdgeKey, at_s: float) -> float | None:
    """Return the last time before `at_s` at which an edge was seen blocked, in seconds of the world; None if never."""
    blocked = [seen.stamp_s for seen in graph.presence.get(edge, ()) if not seen.present and seen.stamp_s <= at_s]
    return blocked[-1] if blocked else None


def explain_decision(made: PresenceDecision) -> Iterator[str]:
    """Yield sentences with numbers that explain why the robot tried the closed edge, or why it did not."""
    source, target = made.edge
    seen = "" if made.seen_s is None else f", {duration_text(made.at_s - made.seen_s)} after it was last seen blocked"
    verdict = f"so it counted as {'open' if made.counts_as_open else 'closed'} (limit {OPEN_ABOVE})"
    yield f"At {clock_text(made.at_s)}{seen}, edge {source} -> {target} was open with p = {made.p:.2f}, {verdict}."
    yield f"The path through it to {made.plan.planned.nodes[-1]} cost {made.through.cost:.2f}."
    if made.counts_as_open:
        cost = made.around.cost
        around = f"The path around it cost {cost:.2f}." if isfinite(cost) else "There was no path around it."
        yield f"This cost includes the doubt whether it is open, and the edge was driven like any other. {around}"
    elif not isfinite(made.around.cost):
        yield from _without_way_around(made)
    else:
        yield from _with_way_around(made)
    if not made.follows_rule:
        yield (
            "The present rule gives another plan: the run used other thresholds or another filter, or had more "
            "information."
        )


def _without_way_around(made: PresenceDecision) -> Iterator[str]:
    yield "There was no path around it."
    if not made.tries:
        yield "No obstacle had been met in this query yet, so the robot drove there to look."
    elif made.p >= HOPELESS_BELOW:
        yield (
            f"An obstacle had been met in this query already; as p is at least {HOPELESS_BELOW}, the robot tried again."
        )
    else:
        yield (
            f"An obstacle had been met in this query already, and p is below {HOPELESS_BELOW}, so the robot did not "
            "try."
        )


def _with_way_around(made: PresenceDecision) -> Iterator[str]:
    yield f"The path around it cost {made.around.cost:.2f}."
    yield (
        f"If the edge turned out closed, the cost was {made.to_edge_cost:.2f} to the edge and {made.back_cost:.2f} "
        f"from there around. So a try was expected to cost {made.p:.2f} x {made.through.cost:.2f} + {1 - made.p:.2f} x "
        f"{made.to_edge_cost + made.back_cost:.2f} = {made.expected_cost:.2f}."
    )
    if made.tries:
        yield "An obstacle had been met in this query already, so the robot goes around without another try."
    elif made.expected_saving > 0:
        yield f"That is {made.expected_saving:.2f} less than going around, so a try was worth it."
    else:
        yield f"That is {-made.expected_saving:.2f} more than going around, so the robot went around."
