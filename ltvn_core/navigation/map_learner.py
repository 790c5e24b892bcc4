"""Map updates from a query: the result of each attempt, and the obstacles seen before it.

Owns the evidence; the system's maintenance and presence decide how it changes the map.
"""

import itertools
from collections.abc import Generator, Iterator, Sequence

from ltvn_core.graph.deltas import PresenceObserved
from ltvn_core.graph.maintenance import AttemptEvidence
from ltvn_core.graph.planner import GraphPath
from ltvn_core.graph.presence.obstruction import edges_obstructed
from ltvn_core.graph.presence.presence_observations import is_open
from ltvn_core.navigation.attempt_driver import AttemptResult
from ltvn_core.navigation.events import OBSTRUCTED_ENDS, Event
from ltvn_core.navigation.judgement import AttemptVerdict
from ltvn_core.navigation.obstruction_finder import find_obstruction, obstruction_ahead, open_ways
from ltvn_core.navigation.perception import NodeMatch
from ltvn_core.navigation.query import MOST_OBSTRUCTIONS, QueryState
from ltvn_core.types import NodeId

_STEPS_OF_A_WAY = 10
"""Number of control steps after which the robot counts as having left the place of the last attempt."""
_EDGES_IN_SIGHT = 4
"""Number of edges at the beginning of a plan that are checked for obstacles."""


def look_for_obstacles(query: QueryState, path: GraphPath) -> Generator[Event, None, bool]:
    """Look for obstacles before an attempt; tell whether a new one closes the path, so that the robot replans."""
    graph = query.context.graph
    presence = query.context.system.presence
    now_s = query.now_s
    in_sight = path.nodes[: _EDGES_IN_SIGHT + 1]
    obstruction = obstruction_ahead(query, in_sight)
    if obstruction is None or not (across := edges_obstructed(graph, obstruction)):
        seen = [edge for edge in open_ways(query) if edge not in query.felt_closed]
        yield from query.apply(presence.observe_open(graph, seen, now_s))
        return False
    yield from query.apply(presence.observe(graph, obstruction, now_s))
    ahead = (edge for edge in itertools.pairwise(in_sight) if edge in across and not query.never_closed(edge))
    closed = [edge for edge in ahead if not is_open(graph, edge)]
    if not closed or query.obstructions >= MOST_OBSTRUCTIONS:
        return False
    query.obstructions += 1
    query.record_failures(across)  # So that this query tries other paths first.
    return True


def learn_from_attempt(
    query: QueryState,
    attempt: int,
    segment: Sequence[NodeId],
    node_match: NodeMatch,
    verdict: AttemptVerdict,
    result: AttemptResult,
) -> Iterator[Event]:
    """Remember a failure for this query, and let the system update the map."""
    context = query.context
    failed_before = any(edge in query.failed for edge in itertools.pairwise(segment))
    obstruction = None
    if not verdict.succeeded:
        query.record_failures(itertools.pairwise(segment))
        blocked = result.end in OBSTRUCTED_ENDS
        # A robot that is stopped before it moves is stopped by the same obstacle as before.
        again = False
        if blocked and result.steps >= _STEPS_OF_A_WAY:
            again = (segment[0], segment[-1]) in query.stopped
            query.stopped.add((segment[0], segment[-1]))
        obstruction = find_obstruction(query, segment, blocked=blocked, again=again)
        if obstruction is not None and obstruction.stopped:
            query.obstructions += 1
        else:
            query.record_failure_from(segment[0])  # No obstacle explains the failure.
    evidence = AttemptEvidence(
        source=segment[0],
        target=segment[-1],
        distance=node_match.distance,
        succeeded=verdict.succeeded,
        failed_before=failed_before,
        hindered=verdict.hindered,
        stamp=query.now_s,
        obstruction=obstruction,
    )
    deltas = context.system.maintenance.after_attempt(context.graph, evidence)
    if evidence.obstructed:
        observed = (each for each in deltas if isinstance(each, PresenceObserved))
        query.felt_closed.update((each.source, each.target) for each in observed)
    yield from query.apply(deltas, attempt)
