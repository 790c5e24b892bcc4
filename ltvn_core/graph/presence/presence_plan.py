"""Plans a detour, or a path through a closed edge if its expected cost is lower.

Owns that choice, as a pure function of a planner.
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
"""p(open) below which a closed edge is not tried again, even if there is no other path."""


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
    """Return the path to drive; empty if there is none, or none that is worth a try.

    Edges that are probably open cost `-belief_weight ln p` more; a detour avoids edges that are probably closed. A path
    through a closed edge is used if its expected cost is lower: with probability p the edge is open, otherwise the
    robot must take a detour from there.

    Args:
        planner: Planner of the map.
        source: Node of the robot.
        goal: Node to reach.
        penalties: Additional costs of edges in this query.
        open_now: p(open) of edges that may be closed.
        belief_weight: Weight of -ln p in the cost of an edge.
        tries: Number of times that a closed edge was tried in this query. After the first, a detour is preferred;
            without one, a closed edge is tried again only if its p(open) is at least `HOPELESS_BELOW`.
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
