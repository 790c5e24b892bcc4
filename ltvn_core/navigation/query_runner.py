"""Runs one query: the navigation loop of the paper (Section III), step by step.

Owns the order of the steps and the events that report them. The decisions are elsewhere: in the strategies of
`graph.navigation_system`, in `graph.planner`, `navigation.attempt_driver` and `navigation.judgement`.
"""

import itertools
import math
from collections.abc import Iterator, Sequence

import numpy as np

from ltvn_core.geometry import compose, relative
from ltvn_core.graph.localiser import LOCAL, Localisation, LocalisationPrior
from ltvn_core.graph.operators import pose_row
from ltvn_core.graph.place_belief import LIKELY, SURE, is_where_expected
from ltvn_core.graph.planner import GraphPath
from ltvn_core.navigation.action_runner import run_action
from ltvn_core.navigation.arrival import AT_TARGET_M, Arrival, check_goal, check_place
from ltvn_core.navigation.attempt_driver import AttemptResult
from ltvn_core.navigation.events import (
    BY_PLACE,
    OBSTRUCTED_ENDS,
    AttemptEnd,
    AttemptEnded,
    AttemptStarted,
    Event,
    Localised,
    NavigatorState,
    Outcome,
    Planned,
    StateChanged,
)
from ltvn_core.navigation.judgement import AttemptVerdict, judge_attempt
from ltvn_core.navigation.map_learner import learn_from_attempt, look_for_obstacles
from ltvn_core.navigation.motion import EventGenerator, QueryAborted
from ltvn_core.navigation.obstruction_finder import departure
from ltvn_core.navigation.perception import NodeMatch
from ltvn_core.navigation.query import QueryState
from ltvn_core.navigation.recovery import LOOKS_PER_TURN, recover, turn, turn_to_see
from ltvn_core.navigation.way_planner import plan_way, way_exists
from ltvn_core.types import NodeId, Waypoint

_AT_NODE_DISTANCE = 0.3
"""Greatest d at which a node is not approached before its successor."""
_AT_START_M = 0.1
"""Driven distance up to which the robot is where it began to localise, in metres."""
_INCONCLUSIVE_ENDS = (AttemptEnd.BLOCKED, AttemptEnd.COLLISION, AttemptEnd.TIMEOUT)
"""Ends of attempts that say something about the surroundings, not about the edge."""


def run(query: QueryState) -> EventGenerator[Arrival]:
    """Localise, plan, drive, judge, update, until the goal is reached; return how the robot knows.

    Raises:
        QueryAborted: The query was given up, or a person cancelled it.
    """
    while True:
        if (yield from query.perception.can_compare()) and (arrival := (yield from check_goal(query))):
            return arrival
        if not query.perception.is_usable:
            yield from _enter(query, NavigatorState.RECOVERING)
            yield from turn_to_see(query)
            continue
        localisation = yield from _localise(query)
        if localisation.node is None:
            yield from _recover(query, Outcome.LOST)
            continue
        path = yield from _plan(query, localisation.node)
        if not path.nodes:
            yield from _recover(query, Outcome.NO_PATH)
            continue
        query.consecutive_failures = 0
        if _looks_first(query):
            yield from turn(query)
            continue
        driven = _until_action(query, path)
        if len(driven.nodes) == 1 < len(path.nodes) and _stands_at_node(query, localisation):
            yield from _act(query, path.nodes[0], path.nodes[1])
        elif arrival := (yield from _follow(query, localisation, driven)):
            return arrival


def _looks_first(query: QueryState) -> bool:
    """Tell whether to turn before driving off, because the first images show several places."""
    p = query.place_p()
    if p is None or p > LIKELY or query.motion.path_m - query.began_at_m > _AT_START_M:
        return False
    query.first_looks += 1
    return query.first_looks <= LOOKS_PER_TURN


def _localise(query: QueryState) -> EventGenerator[Localisation]:
    """Find the node the robot is at."""
    yield from _enter(query, NavigatorState.LOCALISING)
    assumed, query.assumed_node = query.assumed_node, None
    if assumed is not None and assumed in query.context.graph.nodes:
        localisation = _localisation_at(query, assumed)
    else:
        context = query.context
        features = query.perception.features
        prior = LocalisationPrior(query.plan, query.doubted, query.place())
        localisation = context.system.localise(features, context.graph, prior, context.matcher)
    frame = query.perception.observation.step
    yield Localised(
        query=query.number,
        frame=frame,
        node=localisation.node,
        distance=localisation.distance,
        reachability=localisation.reachability,
        runner_up=localisation.runner_up,
        margin=localisation.margin,
        scope=localisation.scope,
        probability=localisation.probability,
    )
    return localisation


def _localisation_at(query: QueryState, node: NodeId) -> Localisation:
    """Return a localisation at a given node, with its waypoint from the place belief, or else from the image."""
    match = query.perception.node_match(node)
    known = query.known_waypoint(node, LIKELY)
    match = match if known is None else match.with_waypoint(known)
    return Localisation(node, match.distance, match.reachability, match.waypoint, None, np.inf, LOCAL)


def _plan(query: QueryState, start: NodeId) -> EventGenerator[GraphPath]:
    """Find the cheapest path; if there is none, let the system extend the map."""
    yield from _enter(query, NavigatorState.PLANNING)
    context = query.context
    query = query
    path = plan_way(query, start)
    if not path.nodes and not way_exists(query, start) and start not in query.searched:
        query.searched.add(start)
        yield from query.apply(
            context.system.maintenance.no_path(context.graph, start, query.goal, context.matcher, context.rng)
        )
        path = plan_way(query, start)
    query.plan = path.nodes
    yield Planned(query.number, path.nodes, path.cost, query.place_p())
    return path


def _until_action(query: QueryState, path: GraphPath) -> GraphPath:
    """Return the beginning of a path that can be driven, up to the next edge with an action."""
    edges = query.context.graph.edges
    for count, edge in enumerate(itertools.pairwise(path.nodes), 1):
        if edges[edge].action:
            return path._replace(nodes=path.nodes[:count])
    return path


def _stands_at_node(query: QueryState, localisation: Localisation) -> bool:
    """Tell whether the robot is close enough to its node to need no approach."""
    node = localisation.node
    known = None if node is None else query.known_waypoint(node, SURE)
    is_there = known is not None and np.hypot(known[0], known[1]) < AT_TARGET_M
    return is_there or localisation.distance <= _AT_NODE_DISTANCE or query.reached == node


def _act(query: QueryState, source: NodeId, target: NodeId) -> EventGenerator[None]:
    """Run the action of an edge; afterwards the robot is at the edge's target, though its wheels did not move."""
    yield from _enter(query, NavigatorState.ACTING)
    edge = (source, target)
    query.reached = None
    succeeded = yield from run_action(query, edge)
    if not succeeded or query.count_drive(edge):
        query.failed.add(edge)
        query.penalties[edge] = math.inf
    if succeeded:
        query.arrive_elsewhere(target)


def _follow(query: QueryState, localisation: Localisation, path: GraphPath) -> EventGenerator[Arrival | None]:
    """Drive to the subgoal; return the arrival if nothing is left to drive because the robot is at the goal."""
    segment = _subgoal_segment(query, path)
    node_match = _departure(query, localisation, segment)
    if node_match is None:
        segment = segment[:1]
        node_match = query.perception.node_match(segment[0])
    source, target = _ends(segment)
    query.approached = target if source is None else None
    query.departure = departure(query, localisation)
    if (yield from look_for_obstacles(query, path)):
        yield from query.motion.wait_one_step()
        return None
    result = yield from _drive(query, segment, node_match)
    query.reached = target if source is None and result.end is AttemptEnd.REACHED else None
    if result.steps:
        return None
    yield from query.motion.wait_one_step()
    if result.end is AttemptEnd.BLOCKED:
        # The same attempt would be blocked again, so the robot turns to look for another way.
        yield from turn(query)
        return None
    if source is None and target == query.goal:
        return (yield from check_place(query))
    # An attempt without a step would be repeated without end, so the robot counts as being there.
    query.assumed_node = target
    return None


def _subgoal_segment(query: QueryState, path: GraphPath) -> tuple[NodeId, ...]:
    """Return the path up to the subgoal; only the goal if the robot is already there."""
    if len(path.nodes) == 1:
        return path.nodes
    chosen = query.context.system.subgoal(path.nodes, lambda node: query.perception.node_match(node).reachability)
    return path.nodes[: chosen + 1]


def _departure(query: QueryState, localisation: Localisation, segment: tuple[NodeId, ...]) -> NodeMatch | None:
    """Return the prediction of the target at departure; None if the robot should first approach the node that it is
    at."""
    source, target = _ends(segment)
    node_match = query.perception.node_match(target)
    driving = query.method.driving
    if source is None and (surveyed := query.surveyed_waypoint(target)) is not None:
        return node_match.with_waypoint(surveyed)
    if source is None and query.is_recognised(node_match.reachability):
        return node_match
    known = query.known_waypoint(target, LIKELY)
    looks_reachable = node_match.reachability >= driving.departure_reachability
    if known is not None and not (looks_reachable and is_where_expected(known, node_match.waypoint)):
        return node_match.with_waypoint(known)
    if looks_reachable or source is None:
        return node_match
    if localisation.distance > _AT_NODE_DISTANCE and query.approached != source:
        return None
    if not driving.through_map:
        return node_match
    return node_match.with_waypoint(_along(query, localisation.waypoint, segment))


def _along(query: QueryState, waypoint: Waypoint, nodes: Sequence[NodeId]) -> Waypoint:
    """Return the waypoint (3,) of the last of `nodes`, by the edges from the first one, which is at `waypoint`
    (3,)."""
    for edge in itertools.pairwise(nodes):
        waypoint = compose(waypoint, np.array(query.context.graph.edges[edge].waypoint))
    return waypoint


def _drive(query: QueryState, segment: tuple[NodeId, ...], node_match: NodeMatch) -> EventGenerator[AttemptResult]:
    """Make one attempt and learn from it."""
    source, target = _ends(segment)
    yield from _enter(query, NavigatorState.DRIVING)
    attempt = next(query.context.attempt_numbers)
    frame = query.perception.observation.step
    yield AttemptStarted(
        query.number, attempt, source, target, frame, pose_row(node_match.waypoint), node_match.reachability
    )
    try:
        query = query
        known = query.surveyed_waypoint(target) if source is None else query.known_waypoint(target, LIKELY)
        is_known = known is not None or _is_by_odometry(query, segment)
        result = yield from query.driver.drive(
            target, node_match.waypoint, is_known=is_known, around=query.nodes_around(LIKELY)
        )
    except QueryAborted as over:
        end = AttemptEnd.CANCELLED if over.outcome is Outcome.CANCELLED else AttemptEnd.TIMEOUT
        yield _ended(query, attempt, source, target, end, AttemptVerdict(False, f"cut short: {over.outcome.value}"))
        raise
    yield from _enter(query, NavigatorState.JUDGING)
    verdict = _judge(query, segment, result)
    yield _ended(query, attempt, source, target, result.end, verdict)
    usable = yield from query.perception.can_compare()
    if verdict.succeeded and not result.steps and query.context.system.follows_presence:
        return result  # A robot that did not move has learned nothing about open edges.
    if source is not None and usable:
        yield from learn_from_attempt(query, attempt, segment, node_match, verdict, result)
    elif source is not None:
        query.record_failures(
            itertools.pairwise(segment)
        )  # So that it is not driven without end; the map stays as it is.
    elif query.context.system.follows_presence and result.end in OBSTRUCTED_ENDS:
        query.doubted.add(target)  # The way to the target is blocked, so the robot is probably not there.
    return result


def _is_by_odometry(query: QueryState, segment: Sequence[NodeId]) -> bool:
    """Tell whether a segment has an edge that only odometry supports, so that its two images may show nothing in
    common."""
    return any(query.context.graph.edges[edge].by_odometry for edge in itertools.pairwise(segment))


def _judge(query: QueryState, segment: Sequence[NodeId], result: AttemptResult) -> AttemptVerdict:
    source, target = _ends(segment)
    driven_too_often = source is not None and query.count_drive((source, target))
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
    known = query.known_waypoint(target, SURE) if is_unsure and source is not None else None
    if known is not None and np.hypot(known[0], known[1]) < AT_TARGET_M:
        if not query.is_recognised(seen.reachability):
            query.assumed_node = target  # The image does not show the target, only the belief does.
        why = "the images of the whole query say that the robot is there"
        return AttemptVerdict(True, why, rule=BY_PLACE)
    return verdict


def _ended(
    query: QueryState, attempt: int, source: NodeId | None, target: NodeId, end: AttemptEnd, verdict: AttemptVerdict
) -> AttemptEnded:
    seen = query.perception.node_match(target)
    frame = query.perception.observation.step
    return AttemptEnded(
        query=query.number,
        attempt=attempt,
        source=source,
        target=target,
        frame=frame,
        end=end,
        distance=seen.distance,
        reachability=seen.reachability,
        succeeded=verdict.succeeded,
        reason=verdict.reason,
        rule=verdict.rule,
    )


def _recover(query: QueryState, why: Outcome) -> EventGenerator[None]:
    yield from _enter(query, NavigatorState.RECOVERING)
    yield from recover(query, why)


def _enter(query: QueryState, state: NavigatorState) -> Iterator[Event]:
    if state is not query.state:
        query.state = state
        yield StateChanged(state)


def _ends(segment: Sequence[NodeId]) -> tuple[NodeId | None, NodeId]:
    """Return the source and the target of an attempt; an approach of a single node has no source."""
    source = None if len(segment) == 1 else segment[0]
    return source, segment[-1]
