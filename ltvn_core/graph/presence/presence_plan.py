"""Plans a detour, or a route through a closed edge when the expected cost is lower.

Owns that choice, as a pure function of a planner. Observes and drives nothing.
"""

import itertools
import math
from collections.abc import Mapping

from ltvn_core.graph.planner import GraphPath, Planner
from ltvn_core.graph.presence.edge_presence import EdgeProbabilities
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.types import NodeId

OPEN_ABOVE = 0.5
"""p(open) below which an edge counts as closed."""
HOPELESS_BELOW = 0.2
"""p(open) below which a closed edge is not tried again, even if there is no other way."""


def plan_by_presence(
    planner: Planner,
    source: NodeId,
    goal: NodeId,
    penalties: Mapping[EdgeKey, float],
    open_now: EdgeProbabilities,
    *,
    belief_weight: float,
    tries: int = 0,
) -> GraphPath:
    """Return the way to take; empty if there is none, or none that is worth a try.

    What is probably open costs `-belief_weight ln p` more, what is probably closed is left out. A way through a closed
    edge is taken if it is expected to be cheaper: with probability p it is open, and else the robot has come as far as
    the edge and must go round from there.

    Args:
        planner: Of the map.
        source: Where the robot is.
        goal: Where it is to go.
        penalties: What edges cost more in this query.
        open_now: How probably edges are open.
        belief_weight: What an edge costs more for each power of e that it is less probable.
        tries: How often a closed edge was tried in this query; after the first time there must be hope.
    """
    closed = {edge for edge, p in open_now.items() if p < OPEN_ABOVE}
    costs = dict(penalties)
    for edge in open_now.keys() - closed:
        costs[edge] = costs.get(edge, 0.0) - belief_weight * math.log(open_now[edge])
    through = planner.plan(source, goal, costs)
    passed = [edge for edge in itertools.pairwise(through.nodes) if edge in closed]
    if not passed:
        return through
    around_costs = costs | dict.fromkeys(closed, math.inf)
    around = planner.plan(source, goal, around_costs)
    p = min(open_now[edge] for edge in passed)
    if not around.nodes:
        return through if not tries or p >= HOPELESS_BELOW else around
    if tries:
        return around
    before = planner.plan(source, passed[0][0], costs)
    back = planner.plan(passed[0][0], goal, around_costs)
    expected = p * through.cost + (1 - p) * (before.cost + back.cost)
    return through if expected < around.cost else around
