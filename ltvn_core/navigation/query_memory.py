"""Memory of one query: which edges were driven and which failed. It ends with the query.

Owns the rules against driving in circles: penalties, repeats, and the node that the robot is assumed at after an
attempt without a step. Beliefs that outlive the query belong to the map.
"""

import itertools
from collections import Counter
from collections.abc import Sequence

from ltvn_core.config import LocalisingConfig, PlanningConfig
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.navigation.events import Outcome
from ltvn_core.types import NodeId

MOST_OBSTRUCTIONS = 4
"""Number of obstructions in one query after which the robot no longer doubts them."""


_MOST_FRESH_HOPES = 2
"""Number of times that closed ways may be tried again, each after a full look around."""


class QueryMemory:
    """Edges driven and failed in one query."""

    def __init__(self, config: PlanningConfig, localising: LocalisingConfig) -> None:
        """Remember nothing yet."""
        self._config = config
        self._patience = localising.doubt_after_failures
        self._driven: Counter[EdgeKey] = Counter()
        self._failed: set[EdgeKey] = set()
        self._stopped: set[EdgeKey] = set()
        self._searched: set[NodeId] = set()
        self._failed_from: Counter[NodeId] = Counter()
        self.penalties: dict[EdgeKey, float] = {}
        """Extra costs of edges for the rest of the query."""
        self.plan: tuple[NodeId, ...] = ()
        """The last plan; the robot is looked for around it first."""
        self.assumed_node: NodeId | None = None
        """Node that the robot is assumed at, because an attempt to reach it took no step; used once."""
        self.consecutive_failures = 0
        """Consecutive observations without a node or without a path."""
        self.give_up_outcome = Outcome.LOST
        """Outcome if the query is given up: no path takes precedence over being lost on the way."""
        self.approached: NodeId | None = None
        """The node that was approached last instead of its successor."""
        self.obstructions = 0
        """How often something was seen to lie across the way."""
        self._fresh_hopes = 0
        self.saw_change = False
        """Something was seen to close an edge, so that places nearby may look different."""
        self.felt_closed: set[EdgeKey] = set()
        """Edges on which something stopped the robot, or that the same thing closes: sight does not open them again."""
        self.doubted: set[NodeId] = set()
        """Nodes the robot does not believe to be at any more."""

    def count_drive(self, edge: EdgeKey) -> bool:
        """Count one more attempt along an edge; tell whether that is so often that it must have failed."""
        self._driven[edge] += 1
        return 0 < self._config.repeat_limit < self._driven[edge]

    def should_expand_from(self, start: NodeId) -> bool:
        """Tell, once per start, that a search for a path from there is worth its time."""
        fresh = start not in self._searched
        self._searched.add(start)
        return fresh

    def has_failed(self, edge: EdgeKey) -> bool:
        """Tell whether an edge failed before in this query."""
        return edge in self._failed

    def record_failure(self, edge: EdgeKey) -> None:
        """Remember a failure, and make the edge dearer."""
        self._failed.add(edge)
        if self._config.failure_penalty:
            self.penalties[edge] = self.penalties.get(edge, 0.0) + self._config.failure_penalty

    def record_stop(self, edge: EdgeKey) -> bool:
        """Remember that something stopped the robot on an edge; tell whether it had done so before."""
        again = edge in self._stopped
        self._stopped.add(edge)
        return again

    def record_failures(self, segment: Sequence[NodeId]) -> None:
        """Remember that an attempt along a path of nodes failed; any of its edges may be the cause."""
        for edge in itertools.pairwise(segment):
            self.record_failure(edge)

    def record_failure_from(self, node: NodeId) -> None:
        """Remember that an attempt from a node failed; where that happens often, the robot is somewhere else."""
        self._failed_from[node] += 1
        if 0 < self._patience <= self._failed_from[node]:
            self.doubted.add(node)

    def begin_anew(self) -> None:
        """Trust every node again and, a few times, try closed ways again; extra costs of edges are kept."""
        self._fresh_hopes += 1
        if self._fresh_hopes <= _MOST_FRESH_HOPES:
            self.obstructions = 0
            self.felt_closed.clear()
        self.doubted.clear()
        self._failed_from.clear()

    def record_localisation_failure(self, why: Outcome) -> None:
        """Count an observation without a node or without a path."""
        if self.consecutive_failures == 0 or why is Outcome.NO_PATH:
            self.give_up_outcome = why
        self.consecutive_failures += 1
        self.plan = ()

    def take_assumed_node(self) -> NodeId | None:
        """Return the node that the robot is assumed at, once."""
        node, self.assumed_node = self.assumed_node, None
        return node
