"""Map updates from a query: the result of each attempt, and the obstacles seen before it.

Owns the evidence; the system's maintenance and presence decide how it changes the map.
"""

import itertools
from collections.abc import Generator, Iterator, Sequence

from ltvn_core.graph.deltas import PresenceObserved
from ltvn_core.graph.localiser import Localisation
from ltvn_core.graph.maintenance import AttemptEvidence
from ltvn_core.graph.planner import GraphPath
from ltvn_core.graph.presence.obstruction import edges_obstructed
from ltvn_core.graph.presence.presence_observations import is_open
from ltvn_core.navigation.attempt_driver import AttemptDriver, AttemptResult
from ltvn_core.navigation.context import NavigationContext
from ltvn_core.navigation.events import OBSTRUCTED_ENDS, Event
from ltvn_core.navigation.judgement import AttemptVerdict
from ltvn_core.navigation.motion import MotionExecutor
from ltvn_core.navigation.obstruction_finder import ObstructionFinder
from ltvn_core.navigation.perception import NodeMatch, Perception
from ltvn_core.navigation.query_memory import MOST_OBSTRUCTIONS, QueryMemory
from ltvn_core.types import NodeId

_STEPS_OF_A_WAY = 10
"""Number of control steps after which the robot counts as having left the place of the last attempt."""
_EDGES_IN_SIGHT = 4
"""Number of edges at the beginning of a plan that are checked for obstacles."""


class MapLearner:
    """Passes the evidence of one query to the map."""

    def __init__(
        self,
        context: NavigationContext,
        motion: MotionExecutor,
        perception: Perception,
        driver: AttemptDriver,
        memory: QueryMemory,
        query: int,
        goal: NodeId,
    ) -> None:
        """Update the map of `context` on the way to `goal`."""
        self._context = context
        self._perception = perception
        self._memory = memory
        self._query = query
        self._goal = goal
        self._obstructions = ObstructionFinder(context, motion, perception, driver)

    @property
    def _now_s(self) -> float:
        return self._context.world_time_s(self._perception.observation.stamp)

    def depart(self, localisation: Localisation) -> None:
        """Remember the robot's localisation before an attempt."""
        self._obstructions.depart(localisation)

    def look(self, path: GraphPath) -> Generator[Event, None, bool]:
        """Look for obstacles before an attempt; tell whether a new one closes the path, so that the robot replans."""
        context = self._context
        presence = context.system.presence
        now_s = self._now_s
        in_sight = path.nodes[: _EDGES_IN_SIGHT + 1]
        obstruction = self._obstructions.look(in_sight)
        if obstruction is None or not (across := edges_obstructed(context.graph, obstruction)):
            seen = [edge for edge in self._obstructions.open_ways() if edge not in self._memory.felt_closed]
            yield from context.apply_deltas(presence.observe_open(context.graph, seen, now_s), self._query)
            return False
        yield from context.apply_deltas(presence.observe(context.graph, obstruction, now_s), self._query)
        # Obstacles beside a goal may seem to close the edges to it.
        ahead = (edge for edge in itertools.pairwise(in_sight) if edge in across and edge[1] != self._goal)
        closed = [edge for edge in ahead if not is_open(context.graph, edge)]
        if not closed or self._memory.obstructions >= MOST_OBSTRUCTIONS:
            return False
        self._memory.obstructions += 1
        for edge in across:
            self._memory.record_failure(edge)  # So that this query tries other paths first.
        return True

    def learn(
        self,
        attempt: int,
        segment: Sequence[NodeId],
        node_match: NodeMatch,
        verdict: AttemptVerdict,
        result: AttemptResult,
    ) -> Iterator[Event]:
        """Remember a failure for this query, and let the system update the map."""
        context = self._context
        memory = self._memory
        failed_before = any(memory.has_failed(edge) for edge in itertools.pairwise(segment))
        obstruction = None
        if not verdict.succeeded:
            memory.record_failures(segment)
            blocked = result.end in OBSTRUCTED_ENDS
            # A robot that is stopped before it moves is stopped by the same obstacle as before.
            came = blocked and result.steps >= _STEPS_OF_A_WAY
            again = came and memory.record_stop((segment[0], segment[-1]))
            obstruction = self._obstructions.find(segment, blocked=blocked, again=again)
            if obstruction is not None and obstruction.stopped:
                memory.obstructions += 1
            else:
                memory.record_failure_from(segment[0])  # No obstacle explains the failure.
        evidence = AttemptEvidence(
            source=segment[0],
            target=segment[-1],
            distance=node_match.distance,
            succeeded=verdict.succeeded,
            failed_before=failed_before,
            hindered=verdict.hindered,
            stamp=self._now_s,
            obstruction=obstruction,
        )
        deltas = context.system.maintenance.after_attempt(context.graph, evidence)
        if evidence.obstructed:
            observed = (each for each in deltas if isinstance(each, PresenceObserved))
            memory.felt_closed.update((each.source, each.target) for each in observed)
        yield from context.apply_deltas(deltas, self._query, attempt)
