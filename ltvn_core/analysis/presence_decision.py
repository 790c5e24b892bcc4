"""Why a plan led by a way that was seen blocked, or round about: both ways, and what was expected of each.

Owns laying open the rule of `graph.presence.presence_plan` for a plan that was made. Plans again on the map as it was
then; the recording stays as it is.
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from math import inf, isfinite, log

from ltvn_core.analysis.edge_presence_history import presence_as_if
from ltvn_core.analysis.plan_alternative import failure_penalties_at
from ltvn_core.analysis.timeline import Timeline
from ltvn_core.analysis.timeline_records import PlanRecord
from ltvn_core.analysis.world_clock import clock_text, duration_text, latest_known_time, world_time_at
from ltvn_core.config import PlanningConfig
from ltvn_core.graph.planner import EdgeWeight, GraphPath, Planner
from ltvn_core.graph.presence.presence_filter import PresenceFilter
from ltvn_core.graph.presence.presence_plan import HOPELESS_BELOW, OPEN_ABOVE, plan_by_presence
from ltvn_core.graph.topological_graph import EdgeKey, TopologicalGraph


@dataclass(frozen=True, slots=True)
class PresenceDecision:
    """One choice between a way through edges that were held to be closed and the best way around."""

    plan: PlanRecord
    """As recorded."""
    at_s: float
    """When it was made, on the clock of the world."""
    edge: EdgeKey
    """The edge of the way through that was least probably open."""
    p: float
    """How probably it was open then."""
    seen_s: float | None
    """When the edge was last seen blocked; None where no observation of that is kept."""
    through: GraphPath
    """The cheapest way as if the edges were open."""
    around: GraphPath
    """The cheapest way without them; empty where there is none."""
    to_edge_cost: float
    """From the start to the first closed edge."""
    back_cost: float
    """From there to the goal without closed edges; infinite where there is no way."""
    tries: int
    """How often something had been in the way earlier in this query."""
    follows_rule: bool
    """Planning again by the rule gives the recorded plan."""

    @property
    def expected_cost(self) -> float:
        """What setting off for the closed edge costs on average: through if it is open, else there and around."""
        return self.p * self.through.cost + (1 - self.p) * (self.to_edge_cost + self.back_cost)

    @property
    def expected_saving(self) -> float:
        """So much less than going around; negative where a try is not worth it."""
        return self.around.cost - self.expected_cost

    @property
    def counts_as_open(self) -> bool:
        """The edge was probably open, so that the plan took it like any other, only a little dearer."""
        return self.p >= OPEN_ABOVE

    @property
    def tried(self) -> bool:
        """The recorded plan leads through the edge."""
        return self.edge in self.plan.edges


def presence_decision(
    timeline: Timeline,
    plan: PlanRecord,
    planning: PlanningConfig,
    presence_filter: PresenceFilter,
    *,
    weight: EdgeWeight | None = None,
) -> PresenceDecision | None:
    """Return what a plan chose between; None where no edge that was last seen blocked lay on its shortest way.

    `planning`, `weight` and `presence_filter` are those of the run. Linear in the changes of the map, and five plans.
    """
    graph = timeline.graph_before(plan.event)
    if not graph.presence or not plan.planned.nodes:
        return None
    at_s = latest_known_time(graph, world_time_at(timeline, plan.instant))
    open_now = presence_as_if(graph, presence_filter, at_s)
    closed = [edge for edge, p in open_now.items() if p < OPEN_ABOVE]
    penalties = failure_penalties_at(timeline, plan.event, planning)
    doubts = {edge: -planning.belief_weight * log(p) for edge, p in open_now.items() if p >= OPEN_ABOVE}
    costs = {edge: penalties.get(edge, 0.0) + doubts.get(edge, 0.0) for edge in penalties.keys() | doubts.keys()}
    planner = Planner(graph, planning, weight=weight)
    start = plan.planned.nodes[0]
    goal = plan.planned.nodes[-1]
    through = planner.plan(start, goal, costs)
    on_way = list(itertools.pairwise(through.nodes))
    passed = [edge for edge in on_way if edge in closed]
    # What was blocked when it was seen last may count as open by now, and be tried like any other edge.
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
    """Return when an edge was last seen blocked before a time, on the clock of the world; None if never."""
    blocked = [seen.stamp_s for seen in graph.presence.get(edge, ()) if not seen.present and seen.stamp_s <= at_s]
    return blocked[-1] if blocked else None


def explain_decision(made: PresenceDecision) -> Iterator[str]:
    """Yield in words and numbers why the robot tried the closed edge, or why it did not."""
    source, target = made.edge
    seen = "" if made.seen_s is None else f", {duration_text(made.at_s - made.seen_s)} after it was last seen blocked"
    verdict = f"so it counted as {'open' if made.counts_as_open else 'closed'} (limit {OPEN_ABOVE})"
    yield f"At {clock_text(made.at_s)}{seen}, edge {source} -> {target} was open with p = {made.p:.2f}, {verdict}."
    yield f"Through it the way to {made.plan.planned.nodes[-1]} cost {made.through.cost:.2f}."
    if made.counts_as_open:
        around = f"cost {made.around.cost:.2f}" if isfinite(made.around.cost) else "was none"
        yield f"The doubt is in that cost, and the edge was driven like any other. The way around it {around}."
    elif not isfinite(made.around.cost):
        yield from _without_way_around(made)
    else:
        yield from _with_way_around(made)
    if not made.follows_rule:
        yield (
            "Planning again by the rule of today gives another way: the run used other thresholds, another filter or "
            "knew more."
        )


def _without_way_around(made: PresenceDecision) -> Iterator[str]:
    yield "There was no way around."
    if not made.tries:
        yield "Nothing had been in the way in this query yet, so it went to see."
    elif made.p >= HOPELESS_BELOW:
        yield f"Something had been in the way in this query already; with p at least {HOPELESS_BELOW} it tried again."
    else:
        yield f"Something had been in the way in this query already, and p is below {HOPELESS_BELOW}: no try."


def _with_way_around(made: PresenceDecision) -> Iterator[str]:
    yield f"Around it, it cost {made.around.cost:.2f}."
    yield (
        f"If it turned out closed: {made.to_edge_cost:.2f} to the edge and {made.back_cost:.2f} from there around. So "
        f"a try was expected to cost {made.p:.2f} x {made.through.cost:.2f} + {1 - made.p:.2f} x "
        f"{made.to_edge_cost + made.back_cost:.2f} = {made.expected_cost:.2f}."
    )
    if made.tries:
        yield "Something had been in the way in this query already: then it goes around without another try."
    elif made.expected_saving > 0:
        yield f"That is {made.expected_saving:.2f} less than going around, so going to look was worth it."
    else:
        yield f"That is {-made.expected_saving:.2f} more than going around, so it went around."
