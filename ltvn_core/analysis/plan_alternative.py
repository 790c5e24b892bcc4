"""Compares a plan through an edge with the best plan without it, and explains the costs of both.

Also owns the form of one step of any explanation. Plans again with `graph.planner` on the map at that time, without
changing the recording.
"""

import itertools
from dataclasses import dataclass
from enum import StrEnum
from math import inf, isclose, isfinite

from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import Instant, PlanRecord
from ltvn_core.config import PlanningConfig
from ltvn_core.graph.deltas import Belief, Cause
from ltvn_core.graph.planner import EdgeWeight, GraphPath, Planner, edge_cost, with_blind_costs
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.terminal_text import count_text
from ltvn_core.types import NodeId


class ExplanationKind(StrEnum):
    """What one line of an explanation is about."""

    BORN = "born"
    """An edge or node was added."""
    ATTEMPT = "attempt"
    """An edge was driven."""
    BELIEF = "belief"
    """The belief that follows from all evidence."""
    GONE = "gone"
    """An edge or node was removed."""
    PLAN = "plan"
    """A plan that contains the edge."""
    PENALTY = "penalty"
    """An edge had an extra cost in one query."""
    ALTERNATIVE = "alternative"
    """The cost of another path."""
    NEVER = "never"
    """Something that never happened."""


@dataclass(frozen=True, slots=True)
class ExplanationStep:
    """One sentence of an explanation, with its links."""

    text: str
    instant: Instant | None
    """The instant that is shown on a click; None if no single instant fits."""
    kind: ExplanationKind
    ids: tuple[NodeId, ...]
    """The nodes in the sentence; source and target of an edge."""


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


@dataclass(frozen=True, slots=True)
class PlanAlternative:
    """A plan through an edge, and the best plan without the edge."""

    edge: EdgeKey
    plan: PlanRecord
    """The recorded plan."""
    belief: Belief
    """Belief of the edge at that time."""
    edge_cost: float
    """Cost of the edge without the penalty."""
    penalty: float
    """Extra cost of the edge, because an attempt failed earlier in this query."""
    blind_cost: float
    """Extra cost of the edge, because no image supports it and the robot may have been at several places."""
    replanned: GraphPath
    """The best path when planned again; equal to the recorded one if the thresholds are the same."""
    without_edge: GraphPath
    """The best path without the edge; empty and of infinite cost if there is none."""

    @property
    def matches_recording(self) -> bool:
        """Whether planning again gives the recorded cost, so that the two costs can be compared."""
        return isclose(self.replanned.cost, self.plan.planned.cost, rel_tol=1e-6, abs_tol=1e-6)


def plan_alternative(
    timeline: Timeline,
    source: NodeId,
    target: NodeId,
    planning: PlanningConfig,
    *,
    at: Instant | None = None,
    weight: EdgeWeight | None = None,
) -> PlanAlternative | None:
    """Compare the last plan through an edge up to an instant with the best plan without it; None if there is no plan.

    `planning` and `weight` are those of the run. Linear in the changes of the map; plans twice.
    """
    edge = (source, target)
    count = timeline.count_until(at)
    plans = [plan for plan in timeline.plans if plan.event < count and edge in plan.edges]
    if not plans:
        return None
    plan = plans[-1]
    graph = timeline.graph_before(plans[-1].event)
    if edge not in graph.edges:
        return None  # The recording does not hold the map of the plan.
    planner = Planner(graph, planning, weight=weight)
    failures = failure_penalties_at(timeline, plan.event, planning)
    penalties = with_blind_costs(graph, failures, plan.place_p)
    belief = graph.edges[edge].belief
    start = plan.planned.nodes[0]
    goal = plan.planned.nodes[-1]
    without_edge = planner.plan(start, goal, {**penalties, edge: inf})
    return PlanAlternative(
        edge=edge,
        plan=plan,
        belief=belief,
        edge_cost=weight(belief) if weight else edge_cost(belief, planning),
        penalty=failures.get(edge, 0.0),
        blind_cost=penalties.get(edge, 0.0) - failures.get(edge, 0.0),
        replanned=planner.plan(start, goal, penalties),
        without_edge=without_edge,
    )


def failure_penalties_at(timeline: Timeline, event: int, planning: PlanningConfig) -> dict[EdgeKey, float]:
    """Return the extra costs of edges just before event number `event`, for failures in the query in progress."""
    progress = timeline.progress_before(event)
    if progress.query is None or not planning.failure_penalty:
        return {}
    return {edge: count * planning.failure_penalty for edge, count in progress.failures.items()}


def explain_planned_edge(
    timeline: Timeline,
    source: NodeId,
    target: NodeId,
    planning: PlanningConfig,
    *,
    at: Instant | None = None,
    weight: EdgeWeight | None = None,
) -> tuple[ExplanationStep, ...]:
    """Explain why the last plan through an edge, up to an instant, used it, and what the alternative was.

    Costs as much as `plan_alternative`.
    """
    made = plan_alternative(timeline, source, target, planning, at=at, weight=weight)
    if made is None:
        text = f"No plan led through edge {source} -> {target}."
        return (ExplanationStep(text, at, ExplanationKind.NEVER, (source, target)),)
    reasons = [_planned(made), _edge_cost_step(made)]
    if made.penalty:
        text = f"{made.penalty:.2f} of its cost is for having failed in this query, and the plan was still the best."
        reasons.append(ExplanationStep(text, made.plan.instant, ExplanationKind.PENALTY, made.edge))
    if made.blind_cost:
        text = (
            f"{made.blind_cost:.2f} of its cost is because no image supports it and the robot was unsure of its place."
        )
        reasons.append(ExplanationStep(text, made.plan.instant, ExplanationKind.PENALTY, made.edge))
    if not made.matches_recording:
        text = (
            f"Planning again costs {made.replanned.cost:.2f}, not {made.plan.planned.cost:.2f} as recorded: the run "
            "used other thresholds or another system, so compare these costs only with each other."
        )
        reasons.append(ExplanationStep(text, made.plan.instant, ExplanationKind.PLAN, made.edge))
    return (*reasons, _alternative(made))


def _planned(made: PlanAlternative) -> ExplanationStep:
    nodes = made.plan.planned.nodes
    cost = made.plan.planned.cost
    number = made.plan.planned.query
    edges_text = count_text(len(nodes) - 1, "edge")
    where = f"In query {number} the robot thought it was at node {nodes[0]}"
    text = f"{where} and planned {edges_text} to {nodes[-1]}, cost {cost:.2f}."
    return ExplanationStep(text, made.plan.instant, ExplanationKind.PLAN, nodes)


def _edge_cost_step(made: PlanAlternative) -> ExplanationStep:
    source, target = made.edge
    cost = made.edge_cost + made.penalty + made.blind_cost
    text = f"Edge {source} -> {target} cost {cost:.2f} of that: {belief_text(made.belief)}."
    return ExplanationStep(text, made.plan.instant, ExplanationKind.BELIEF, made.edge)


def _alternative(made: PlanAlternative) -> ExplanationStep:
    if not isfinite(made.without_edge.cost):
        text = "Without it there is no path at all."
        ids = made.edge
    else:
        more = made.without_edge.cost - made.replanned.cost
        ids = made.without_edge.nodes
        fresh = len(set(itertools.pairwise(ids)) - set(made.plan.edges))
        text = (
            f"The best path without it costs {made.without_edge.cost:.2f}, {more:.2f} more, with "
            f"{count_text(len(ids) - 1, 'edge')}, {fresh} of them not on the plan."
        )
    return ExplanationStep(text, made.plan.instant, ExplanationKind.ALTERNATIVE, ids)
