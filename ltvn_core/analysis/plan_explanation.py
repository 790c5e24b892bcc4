"""Why a plan used or avoided an edge: because of its cost, or because it was last seen blocked.

Compares the plan with the best plan without the edge, and explains the costs of both. Plans again on the map at that
time (`analysis.replanning`), without changing the recording. Also owns the form of a sentence of any explanation.
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from math import inf, isclose, isfinite, log
from typing import NamedTuple

from ltvn_core.analysis.replanning import Rules, moment_of_plan, replan
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import Instant, PlanRecord
from ltvn_core.analysis.what_if_changes import WithoutEdge
from ltvn_core.analysis.world_clock import clock_text, duration_text
from ltvn_core.graph.deltas import Belief, Cause
from ltvn_core.graph.planner import GraphPath, Planner
from ltvn_core.graph.presence.edge_presence import HOPELESS_BELOW, OPEN_ABOVE
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.terminal_text import count_text
from ltvn_core.types import NodeId


class Reason(NamedTuple):
    """One sentence of an explanation."""

    text: str
    instant: Instant | None = None
    """The instant that is shown on a click; None if no single instant fits."""


CAUSE_TEXTS = {
    Cause.BUILD: "when the map was built",
    Cause.ONLINE: "while somebody drove",
    Cause.ATTEMPT: "after it was driven",
    Cause.NOVEL: "because the robot was lost and saw no known place",
    Cause.EXPAND: "because there was no path without it",
    Cause.GOAL: "to connect a goal",
    Cause.LOAD: "with a map from a file",
    Cause.SIGHT: "because of what was seen",
    Cause.HAND: "by hand",
}
"""The text for each cause."""


def belief_text(belief: Belief) -> str:
    """Return a belief as text."""
    return f"p = {belief.p:.2f}, length (mu) = {belief.mu:.2f}"


def explain_planned_edge(
    timeline: Timeline, source: NodeId, target: NodeId, rules: Rules, *, at: Instant | None = None
) -> tuple[Reason, ...]:
    """Explain why the last plan through an edge, up to an instant, used it, and what the alternative was.

    `rules` are those of the run; whether edges are open is left to `presence_decision`. Linear in the changes of the
    map; plans twice.
    """
    edge = (source, target)
    count = timeline.count_until(at)
    plan = next((each for each in reversed(timeline.plans) if each.event < count and edge in each.edges), None)
    moment = None if plan is None else moment_of_plan(timeline, plan)
    if plan is None or moment is None or edge not in moment.graph.edges:  # The recording may not hold the plan's map.
        return (Reason(f"No plan led through edge {source} -> {target}."),)
    rules = rules._replace(presence_filter=None)
    again = replan(moment, (), rules).path
    without = replan(moment, [WithoutEdge(*edge)], rules).path
    belief = moment.graph.edges[edge].belief
    failed = moment.failures.get(edge, 0) * rules.method.planning.failure_penalty
    blind = moment.penalties(rules).get(edge, 0.0) - failed
    cost = rules.edge_weight_of(rules.method)(belief) + failed + blind
    nodes = plan.planned.nodes
    edges_text = count_text(len(nodes) - 1, "edge")
    texts = [
        f"In query {plan.planned.query} the robot thought it was at node {nodes[0]} and planned {edges_text} to "
        f"{nodes[-1]}, cost {plan.planned.cost:.2f}.",
        f"Edge {source} -> {target} cost {cost:.2f} of that: {belief_text(belief)}.",
    ]
    if failed:
        texts.append(f"{failed:.2f} of its cost is for having failed in this query, and the plan was still the best.")
    if blind:
        texts.append(f"{blind:.2f} of its cost is because no image supports it and the robot was unsure of its place.")
    if not isclose(again.cost, plan.planned.cost, rel_tol=1e-6, abs_tol=1e-6):
        texts.append(
            f"Planning again costs {again.cost:.2f}, not {plan.planned.cost:.2f} as recorded: the run used other "
            "thresholds or another system, so compare these costs only with each other."
        )
    if isfinite(without.cost):
        fresh = len(set(itertools.pairwise(without.nodes)) - set(plan.edges))
        texts.append(
            f"The best path without it costs {without.cost:.2f}, {without.cost - again.cost:.2f} more, with "
            f"{count_text(len(without.nodes) - 1, 'edge')}, {fresh} of them not on the plan."
        )
    else:
        texts.append("Without it there is no path at all.")
    return tuple(Reason(text, plan.instant) for text in texts)


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


def presence_decision(timeline: Timeline, plan: PlanRecord, rules: Rules) -> PresenceDecision | None:
    """Return the two alternatives of a plan; None if its shortest path has no edge that was last seen blocked.

    `rules` are those of the run. Linear in the changes of the map; plans five times.
    """
    if not plan.planned.nodes:
        return None
    moment = moment_of_plan(timeline, plan)
    graph = moment.graph
    open_now = moment.open_edges(rules)
    if not open_now:
        return None
    closed = [edge for edge, p in open_now.items() if p < OPEN_ABOVE]
    planning = rules.method.planning
    penalties = moment.penalties(rules)
    doubts = {edge: -planning.belief_weight * log(p) for edge, p in open_now.items() if p >= OPEN_ABOVE}
    costs = {edge: penalties.get(edge, 0.0) + doubts.get(edge, 0.0) for edge in penalties.keys() | doubts.keys()}
    planner = Planner(graph, planning, weight=rules.edge_weight_of(rules.method))
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
    blocked = [s.stamp_s for s in graph.presence[edge] if not s.present and s.stamp_s <= moment.at_s]
    return PresenceDecision(
        plan=plan,
        at_s=moment.at_s,
        edge=edge,
        p=open_now[edge],
        seen_s=blocked[-1] if blocked else None,
        through=through,
        around=planner.plan(start, goal, without),
        to_edge_cost=planner.plan(start, passed[0][0], costs).cost,
        back_cost=planner.plan(passed[0][0], goal, without).cost,
        tries=moment.tries,
        follows_rule=replan(moment, (), rules).path.nodes == plan.planned.nodes,
    )


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
