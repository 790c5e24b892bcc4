"""Plans paths for one query, over the edges that exist and are open now.

Owns the costs of a plan. The search itself is in `graph.planner` and `graph.presence.presence_plan`.
"""

import math

from ltvn_core.graph.planner import NO_PATH, GraphPath, with_blind_costs
from ltvn_core.graph.presence.edge_presence import EdgeProbabilities
from ltvn_core.graph.presence.presence_plan import OPEN_ABOVE, plan_by_presence
from ltvn_core.navigation.query import MOST_OBSTRUCTIONS, QueryState
from ltvn_core.types import NodeId

_LEAST_P = 1e-3
"""Lower limit of the probability that an edge is open."""


def plan_way(query: QueryState, start: NodeId) -> GraphPath:
    """Return the path to take from a node to the goal now."""
    context = query.context
    penalties = with_blind_costs(context.graph, query.penalties, query.place_p())
    open_now = context.system.presence.probabilities(context.graph, query.now_s)
    open_now = {edge: max(p, OPEN_ABOVE) if query.never_closed(edge) else p for edge, p in open_now.items()}
    if not open_now:
        return context.planner.plan(start, query.goal, penalties)
    path = plan_by_presence(
        context.planner,
        start,
        query.goal,
        penalties,
        open_now,
        belief_weight=query.method.planning.belief_weight,
        tries=query.obstructions,
    )
    return path if path.nodes else _hope(query, start, open_now)


def way_exists(query: QueryState, start: NodeId) -> bool:
    """Tell whether the map has any path to the goal, over open or closed edges."""
    return bool(query.context.planner.plan(start, query.goal, query.penalties).nodes)


def _hope(query: QueryState, start: NodeId, open_now: EdgeProbabilities) -> GraphPath:
    """Return the path that is most probably open although some of its edges seem closed.

    This is done only a few times per query.
    """
    if query.obstructions >= MOST_OBSTRUCTIONS:
        return NO_PATH
    costs = dict(query.penalties)
    belief_weight = query.method.planning.belief_weight
    for edge, p in open_now.items():
        costs[edge] = costs.get(edge, 0.0) - belief_weight * math.log(max(p, _LEAST_P))
    return query.context.planner.plan(start, query.goal, costs)
