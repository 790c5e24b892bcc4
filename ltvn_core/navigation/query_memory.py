"""Memory of one query: which edges were driven and which failed. It is discarded after the query.

Owns the rules against driving in circles: penalties, the limit of repeats, and the assumed node after an attempt that
took no step. Beliefs that outlive the query belong to the map.
"""

import itertools
import math
from collections import Counter
from collections.abc import Sequence

from ltvn_core.config import LocalisingConfig, PlanningConfig
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.navigation.events import Outcome
from ltvn_core.types import NodeId

MOST_OBSTRUCTIONS = 4
"""Number of obstructions in one query after which the robot plans no more paths through edges that seem closed."""


_MOST_FRESH_HOPES = 2
"""Number of times that closed edges may be tried again, each after a full look around."""


class QueryMemory:
    """Edges driven and failed in one query."""

    def __init__(self, config: PlanningConfig, localising: LocalisingConfig) -> None:
        """Start with an empty memory."""
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
        """Nodes of the last plan; localisation searches around them first."""
        self.assumed_node: NodeId | None = None
        """Node where the robot is assumed to be, because an attempt to reach it took no step; used once."""
        self.consecutive_failures = 0
        """Consecutive observations without a node or without a path."""
        self.give_up_outcome = Outcome.LOST
        """Outcome if the query is given up; `NO_PATH` takes precedence over `LOST`."""
        self.approached: NodeId | None = None
        """The node that the robot last approached before driving to its successor."""
        self.first_looks = 0
        """Number of turns since the place was forgotten, because the robot could be at several places."""
        self.began_at_m = 0.0
        """Distance driven when the place was forgotten, in metres."""
        self.surveys = 0
        """Number of turns on the spot to see whether the goal is here."""
        self.obstructions = 0
        """Number of obstructions met so far."""
        self._fresh_hopes = 0
        self.felt_closed: set[EdgeKey] = set()
        """Edges closed by an obstacle that stopped the robot; an image of a free path does not reopen them."""
        self.doubted: set[NodeId] = set()
        """Nodes that localisation excludes, because attempts from them or to them failed."""

    def count_drive(self, edge: EdgeKey) -> bool:
        """Count an attempt along an edge; tell whether the number of attempts exceeds the limit of repeats."""
        self._driven[edge] += 1
        return 0 < self._config.repeat_limit < self._driven[edge]

    def should_expand_from(self, start: NodeId) -> bool:
        """Tell whether no path was searched from a start yet; True once per start."""
        fresh = start not in self._searched
        self._searched.add(start)
        return fresh

    def has_failed(self, edge: EdgeKey) -> bool:
        """Tell whether an edge failed before in this query."""
        return edge in self._failed

    def record_failure(self, edge: EdgeKey) -> None:
        """Remember a failure, and raise the cost of the edge."""
        self._failed.add(edge)
        if self._config.failure_penalty:
            self.penalties[edge] = self.penalties.get(edge, 0.0) + self._config.failure_penalty

    def close(self, edge: EdgeKey) -> None:
        """Exclude an edge from all plans for the rest of the query."""
        self._failed.add(edge)
        self.penalties[edge] = math.inf

    def arrive_elsewhere(self, node: NodeId) -> None:
        """Remember that the robot was taken to a node; what was known about its place before no longer holds."""
        self.assumed_node = node
        self.approached = None
        self.doubted.clear()

    def record_stop(self, edge: EdgeKey) -> bool:
        """Remember that an obstacle stopped the robot on an edge; tell whether this happened before."""
        again = edge in self._stopped
        self._stopped.add(edge)
        return again

    def record_failures(self, segment: Sequence[NodeId]) -> None:
        """Remember that an attempt along a path of nodes failed; any of its edges may be the cause."""
        for edge in itertools.pairwise(segment):
            self.record_failure(edge)

    def record_failure_from(self, node: NodeId) -> None:
        """Remember that an attempt from a node failed; after several failures, doubt that the robot is there."""
        self._failed_from[node] += 1
        if 0 < self._patience <= self._failed_from[node]:
            self.doubted.add(node)

    def begin_anew(self, driven_m: float) -> None:
        """Trust all nodes again and, a few times per query, allow closed edges again; the penalties are kept.

        `driven_m` is the distance driven so far, in metres.
        """
        self.first_looks = 0
        self.began_at_m = driven_m
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
        """Return the assumed node of the robot, and forget it."""
        node, self.assumed_node = self.assumed_node, None
        return node
