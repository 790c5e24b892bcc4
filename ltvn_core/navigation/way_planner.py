"""Plans paths for one query, over the edges that exist and are open now.

Owns the costs of a plan. The search itself is in `graph.planner` and `graph.presence.presence_plan`.
"""

import math

from ltvn_core.graph.planner import NO_PATH, GraphPath
from ltvn_core.graph.presence.edge_presence import EdgeProbabilities
from ltvn_core.graph.presence.presence_plan import OPEN_ABOVE, plan_by_presence
from ltvn_core.navigation.context import NavigationContext
from ltvn_core.navigation.query_memory import MOST_OBSTRUCTIONS, QueryMemory
from ltvn_core.types import NodeId

_LEAST_P = 1e-3
"""Lower limit of the probability that an edge is open."""


class WayPlanner:
    """Plans for one query."""

    def __init__(self, context: NavigationContext, memory: QueryMemory, goal: NodeId) -> None:
        """Plan paths to `goal` in the map of `context`, with the penalties in `memory`."""
        self._context = context
        self._memory = memory
        self._goal = goal

    def plan(self, start: NodeId, stamp: float) -> GraphPath:
        """Return the path to take from a node at a moment on the robot's clock.

        The last edge to the goal never counts as closed, because obstacles beside the goal may seem to close it.
        """
        context = self._context
        penalties = self._memory.penalties
        open_now = context.system.presence.probabilities(context.graph, context.world_time_s(stamp))
        open_now = {edge: p if edge[1] != self._goal else max(p, OPEN_ABOVE) for edge, p in open_now.items()}
        if not open_now:
            return context.planner.plan(start, self._goal, penalties)
        path = plan_by_presence(
            context.planner,
            start,
            self._goal,
            penalties,
            open_now,
            belief_weight=context.method.planning.belief_weight,
            tries=self._memory.obstructions,
        )
        return path if path.nodes else self._hope(start, open_now)

    def _hope(self, start: NodeId, open_now: EdgeProbabilities) -> GraphPath:
        """Return the path that is most probably open although some of its edges seem closed.

        This is done only a few times per query.
        """
        context = self._context
        memory = self._memory
        if memory.obstructions >= MOST_OBSTRUCTIONS:
            return NO_PATH
        costs = dict(memory.penalties)
        belief_weight = context.method.planning.belief_weight
        for edge, p in open_now.items():
            costs[edge] = costs.get(edge, 0.0) - belief_weight * math.log(max(p, _LEAST_P))
        return context.planner.plan(start, self._goal, costs)

    def exists(self, start: NodeId) -> bool:
        """Tell whether the map has any path to the goal, over open or closed edges."""
        return bool(self._context.planner.plan(start, self._goal, self._memory.penalties).nodes)
