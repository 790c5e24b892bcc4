"""What an attempt shows: the verdict about it, the evidence for Eq. 3 and 4, and the obstacles seen before it.

The network that created a false edge also accepts the end of it. The robust method therefore needs independent
evidence: the place belief, which uses all images on the way. Owns the verdict and the evidence; the system's
maintenance and presence decide how it changes the map.
"""

import itertools
from collections.abc import Generator, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ltvn_core.config import Method
from ltvn_core.geometry import distance, relative
from ltvn_core.graph.deltas import BeliefUpdated, PresenceObserved
from ltvn_core.graph.maintenance import AttemptEvidence
from ltvn_core.graph.place_belief import SURE
from ltvn_core.graph.planner import GraphPath
from ltvn_core.graph.presence.edge_presence import is_open
from ltvn_core.graph.presence.obstruction import edges_obstructed
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.navigation.arrival import AT_TARGET_M
from ltvn_core.navigation.attempt_driver import AttemptResult
from ltvn_core.navigation.events import BY_PLACE, OBSTRUCTED_ENDS, AttemptEnd, Event
from ltvn_core.navigation.obstruction_finder import find_obstruction, obstruction_ahead, open_ways
from ltvn_core.navigation.perception import NodeMatch
from ltvn_core.navigation.query import MOST_OBSTRUCTIONS, QueryState
from ltvn_core.types import NodeId, Waypoint

_SUCCESS_DISTANCE, _SUCCESS_REACHABILITY = "judging.success_distance", "judging.success_reachability"
_INCONCLUSIVE_ENDS = (AttemptEnd.BLOCKED, AttemptEnd.COLLISION, AttemptEnd.TIMEOUT)
"""Ends of attempts that say something about the surroundings, not about the edge."""
_AT_TARGET_DISTANCE = 0.3
"""Distance d below which the robot is at the target."""


class AttemptVerdict(NamedTuple):
    """Whether an attempt succeeded, and which rule decided."""

    succeeded: bool
    reason: str
    hindered: bool = False
    """Whether the attempt failed for a reason that says little about the edge."""
    rule: str = ""
    """Name of the rule in `config`; empty if it has none."""


def judge_attempt(
    reachability: float,
    target_distance: float,
    odometry_error: Waypoint,
    method: Method,
    *,
    fits_place: bool = True,
    hindered: bool = False,
    driven_too_often: bool = False,
) -> AttemptVerdict:
    """Judge an attempt by the arrival image o_d: it succeeded if the target is reachable and near.

    `odometry_error`: (3,) rest of the waypoint by odometry. `fits_place`: the place belief does not exclude the target.
    `hindered`: an obstacle, a collision or the step limit ended the attempt. `driven_too_often`: the attempts along the
    edge exceed their limit in this query.
    """
    judging = method.judging
    within = judging.success_distance or method.building.connect_distance
    needed = judging.success_reachability if judging.success_distance else method.building.connect_reachability
    if reachability <= needed:
        # If image and odometry both place the target here, it is probably here and only hard to recognise.
        at_target = max(target_distance, float(distance(odometry_error))) < _AT_TARGET_DISTANCE
        why = f"target does not look reachable: r = {reachability:.2f}, needs {needed:.2f}"
        return AttemptVerdict(False, why, hindered or at_target, rule=_SUCCESS_REACHABILITY)
    if target_distance >= within:
        why = f"target is still too far: d = {target_distance:.2f}, needs {within:.2f}"
        return AttemptVerdict(False, why, hindered, rule=_SUCCESS_DISTANCE)
    if not fits_place:
        why = "the images of the whole query say that the target is elsewhere"
        return AttemptVerdict(False, why, rule=BY_PLACE)
    if driven_too_often:
        return AttemptVerdict(False, "driven too often in this query", hindered=True, rule="planning.repeat_limit")
    why = f"target is near: d = {target_distance:.2f}, r = {reachability:.2f}"
    return AttemptVerdict(True, why, rule=_SUCCESS_DISTANCE)


def judge(query: QueryState, segment: Sequence[NodeId], result: AttemptResult) -> AttemptVerdict:
    """Judge an attempt along a path of nodes by the current image, the place belief and odometry."""
    source, target = segment[0], segment[-1]
    is_edge = len(segment) > 1
    driven_too_often = is_edge and query.count_drive((source, target))
    if not query.perception.is_usable:
        return AttemptVerdict(False, "the last image has no depth, so it cannot be judged", hindered=True)
    seen = query.perception.node_match(target)
    left = relative(query.motion.odometry, result.goal)
    place = query.place()
    verdict = judge_attempt(
        seen.reachability,
        seen.distance,
        left,
        query.method,
        fits_place=place is None or not place.rules_out(target, seen.waypoint, SURE),
        hindered=result.end in _INCONCLUSIVE_ENDS,
        driven_too_often=driven_too_often,
    )
    is_unsure = not verdict.succeeded and result.end is AttemptEnd.REACHED and not driven_too_often
    known = query.known_waypoint(target, SURE) if is_unsure and is_edge else None
    if known is not None and np.hypot(known[0], known[1]) < AT_TARGET_M:
        if not query.is_recognised(seen.reachability):
            query.assumed_node = target  # The image does not show the target, only the belief does.
        why = "the images of the whole query say that the robot is there"
        return AttemptVerdict(True, why, rule=BY_PLACE)
    return verdict


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


def learn_from_action(query: QueryState, edge: EdgeKey, *, succeeded: bool) -> Iterator[BeliefUpdated]:
    """Yield updates of the belief in the existence of an edge with an action.

    The length of the edge was not measured, and only a person may remove it.
    """
    context = query.context
    known = context.graph.edges.get(edge)
    if known is None:
        return
    evidence = AttemptEvidence(*edge, distance=known.belief.mu, succeeded=succeeded, stamp=query.now_s)
    for delta in context.system.maintenance.after_attempt(context.graph, evidence):
        if isinstance(delta, BeliefUpdated):
            yield delta
