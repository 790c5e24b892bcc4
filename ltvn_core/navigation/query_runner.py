"""Runs one query: the navigation loop of the paper (Section III), step by step.

Owns the order of the steps, the events that report them, and the costs of a plan. The decisions are elsewhere: in the
strategies of `graph.navigation_system`, in `graph.planner`, `graph.presence.edge_presence`, `navigation.attempt_driver`
and `navigation.learning`.
"""

import itertools
import math
from collections.abc import Sequence

import numpy as np

from ltvn_core.geometry import agree, compose, relative
from ltvn_core.graph.localiser import LOCAL, Localisation, LocalisationPrior
from ltvn_core.graph.node_layout import SAME_POSE
from ltvn_core.graph.operators import pose_row
from ltvn_core.graph.place_belief import LIKELY, SURE
from ltvn_core.graph.planner import GraphPath, with_blind_costs
from ltvn_core.graph.presence.edge_presence import OPEN_ABOVE, plan_by_presence
from ltvn_core.graph.topological_graph import EdgeKey
from ltvn_core.navigation import events as e
from ltvn_core.navigation.action_performer import ActionState
from ltvn_core.navigation.arrival import (
    AT_TARGET_M,
    LOOKS_PER_TURN,
    TURN_RAD,
    Arrival,
    check_goal,
    check_place,
    recover,
    turn_to_see,
)
from ltvn_core.navigation.attempt_driver import AttemptResult
from ltvn_core.navigation.disambiguation import is_ambiguous, tell_apart
from ltvn_core.navigation.learning import (
    AttemptVerdict,
    departure,
    judge,
    learn_from_action,
    learn_from_attempt,
    look_for_obstacles,
)
from ltvn_core.navigation.perception import EventGenerator, NodeMatch, QueryAborted
from ltvn_core.navigation.query import MOST_OBSTRUCTIONS, QueryState
from ltvn_core.types import NodeId

_AT_NODE_DISTANCE = 0.3
"""Greatest d at which a node is not approached before its successor."""
_TRUST_IN_IMAGE = 0.5
"""Share of the way from the waypoint by the place belief to the one that the image shows."""
_AT_START_M = 0.1
"""Driven distance up to which the robot is where it began to localise, in metres."""
_LEAST_P = 1e-3
"""Lower limit of the probability that an edge is open."""


def run(query: QueryState) -> EventGenerator[Arrival]:
    """Localise, plan, drive, judge, update, until the goal is reached; return how the robot knows.

    Raises:
        QueryAborted: The query was given up, or a person cancelled it.
    """
    while True:
        if (yield from query.perception.can_compare()) and (arrival := (yield from check_goal(query))):
            return arrival
        if not query.perception.is_usable:
            yield from turn_to_see(query)
            continue
        localisation = yield from _localise(query)
        if localisation.node is None:
            yield from recover(query, e.Outcome.LOST)
            continue
        path = yield from _plan(query, localisation.node)
        if not path.nodes:
            yield from recover(query, e.Outcome.NO_PATH)
            continue
        query.consecutive_failures = 0
        if _looks_first(query):
            yield from query.driver.turn(TURN_RAD)
            continue
        if is_ambiguous(query) and (yield from tell_apart(query, LIKELY)):
            continue
        driven = _until_action(query, path)
        if len(driven.nodes) == 1 < len(path.nodes) and _stands_at_node(query, localisation):
            yield from _act(query, (path.nodes[0], path.nodes[1]))
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
    yield from query.enter(e.NavigatorState.LOCALISING)
    assumed, query.assumed_node = query.assumed_node, None
    if assumed is not None and assumed in query.context.graph.nodes:
        match = query.perception.node_match(assumed)
        known = query.known_waypoint(assumed, LIKELY)
        match = match if known is None else match.with_waypoint(known)
        localisation = Localisation(assumed, match.distance, match.reachability, match.waypoint, None, np.inf, LOCAL)
    else:
        context = query.context
        features = query.perception.features
        prior = LocalisationPrior(query.plan, query.doubted, query.place())
        localisation = context.system.localise(features, context.graph, prior, context.matcher)
    seen = localisation._asdict()
    del seen["waypoint"]
    yield e.Localised(query.number, query.perception.observation.step, **seen)
    return localisation


def _plan(query: QueryState, start: NodeId) -> EventGenerator[GraphPath]:
    """Find the cheapest path; if there is none, let the system extend the map."""
    yield from query.enter(e.NavigatorState.PLANNING)
    context = query.context
    path = _plan_now(query, start)
    if (
        not path.nodes
        and not context.planner.plan(start, query.goal, query.penalties).nodes  # Not even over closed edges.
        and start not in query.searched
    ):
        query.searched.add(start)
        yield from query.apply(
            context.system.maintenance.no_path(context.graph, start, query.goal, context.matcher, context.rng)
        )
        path = _plan_now(query, start)
    query.plan = path.nodes
    yield e.Planned(query.number, path.nodes, path.cost, query.place_p())
    return path


def _plan_now(query: QueryState, start: NodeId) -> GraphPath:
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
    if path.nodes or query.obstructions >= MOST_OBSTRUCTIONS:
        return path
    # A few times per query, the robot takes the path that is most probably open although some edges seem closed.
    costs = dict(query.penalties)
    for edge, p in open_now.items():
        costs[edge] = costs.get(edge, 0.0) - query.method.planning.belief_weight * math.log(max(p, _LEAST_P))
    return context.planner.plan(start, query.goal, costs)


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


def _act(query: QueryState, edge: EdgeKey) -> EventGenerator[None]:
    """Run the action of an edge while the robot stands still, and update the belief in the edge.

    Waiting does not count against the step limit, because a lift may take its time. Afterwards the robot is at the
    edge's target, though its wheels did not move. Without an action performer, every action fails at once.
    """
    yield from query.enter(e.NavigatorState.ACTING)
    query.reached = None
    action = query.context.graph.edges[edge].action
    performer = query.context.actions
    yield e.ActionBegun(query.number, *edge, query.perception.observation.step, action)
    succeeded = False
    failure = "nobody performs actions here"
    try:
        yield from query.motion.wait_one_step()  # So that the robot stands, and no plan is repeated without end.
        if performer is not None:
            performer.begin(*edge, action)
            while (state := performer.state()) is ActionState.PENDING:
                yield from query.motion.stand_by()
            yield from query.motion.stand_by()  # So that the robot reads its sensors where it is now.
            succeeded = state is ActionState.DONE
            failure = "" if succeeded else "it could not be done"
    except QueryAborted as over:
        frame = query.perception.observation.step
        yield e.ActionEnded(query.number, *edge, frame, succeeded=False, reason=f"cut short: {over.outcome.value}")
        raise
    frame = query.perception.observation.step
    yield e.ActionEnded(query.number, *edge, frame, succeeded=succeeded, reason=failure)
    if performer is not None:
        yield from query.apply(learn_from_action(query, edge, succeeded=succeeded))
    if not succeeded or query.count_drive(edge):
        query.failed.add(edge)
        query.penalties[edge] = math.inf
    if succeeded:
        query.arrive_elsewhere(edge[1])


def _follow(query: QueryState, localisation: Localisation, path: GraphPath) -> EventGenerator[Arrival | None]:
    """Drive to the subgoal; return the arrival if nothing is left to drive because the robot is at the goal."""
    subgoal, perception = query.context.system.subgoal, query.perception
    chosen = subgoal(path.nodes, lambda node: perception.node_match(node).reachability) if path.nodes[1:] else 0
    segment = path.nodes[: chosen + 1]
    node_match = _departure(query, localisation, segment)
    if node_match is None:
        segment = segment[:1]
        node_match = perception.node_match(segment[0])
    source, target = _ends(segment)
    query.approached = target if source is None else None
    query.departure = departure(query, localisation)
    if (yield from look_for_obstacles(query, path)):
        yield from query.motion.wait_one_step()
        return None
    result = yield from _drive(query, segment, node_match)
    query.reached = target if source is None and result.end is e.AttemptEnd.REACHED else None
    if result.steps:
        return None
    yield from query.motion.wait_one_step()
    if result.end is e.AttemptEnd.BLOCKED:
        # The same attempt would be blocked again, so the robot turns to look for another way.
        yield from query.driver.turn(TURN_RAD)
        return None
    if source is None and target == query.goal:
        return (yield from check_place(query))
    # An attempt without a step would be repeated without end, so the robot counts as being there.
    query.assumed_node = target
    return None


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
    if known is not None and looks_reachable and agree(known, node_match.waypoint, SAME_POSE):
        # Along a bare wall, an image tells less of the distance than odometry since the images before.
        known = compose(known, _TRUST_IN_IMAGE * relative(known, node_match.waypoint))
    if known is not None:
        return node_match.with_waypoint(known)
    if looks_reachable or source is None:
        return node_match
    if localisation.distance > _AT_NODE_DISTANCE and query.approached != source:
        return None
    if not driving.through_map:
        return node_match
    waypoint = localisation.waypoint
    for edge in itertools.pairwise(segment):
        waypoint = compose(waypoint, np.array(query.context.graph.edges[edge].waypoint))
    return node_match.with_waypoint(waypoint)


def _drive(query: QueryState, segment: tuple[NodeId, ...], node_match: NodeMatch) -> EventGenerator[AttemptResult]:
    """Make one attempt and learn from it."""
    source, target = _ends(segment)
    yield from query.enter(e.NavigatorState.DRIVING)
    attempt = next(query.context.attempt_numbers)
    frame = query.perception.observation.step
    yield e.AttemptStarted(
        query.number, attempt, source, target, frame, pose_row(node_match.waypoint), node_match.reachability
    )
    try:
        known = query.surveyed_waypoint(target) if source is None else query.known_waypoint(target, LIKELY)
        # The two images of an edge that only odometry supports may show nothing in common.
        edges = query.context.graph.edges
        is_known = known is not None or any(edges[edge].by_odometry for edge in itertools.pairwise(segment))
        result = yield from query.driver.drive(
            target, node_match.waypoint, is_known=is_known, around=query.nodes_around(LIKELY)
        )
    except QueryAborted as over:
        end = e.AttemptEnd.CANCELLED if over.outcome is e.Outcome.CANCELLED else e.AttemptEnd.TIMEOUT
        yield _ended(query, attempt, source, target, end, AttemptVerdict(False, f"cut short: {over.outcome.value}"))
        raise
    yield from query.enter(e.NavigatorState.JUDGING)
    verdict = judge(query, segment, result)
    yield _ended(query, attempt, source, target, result.end, verdict)
    usable = yield from query.perception.can_compare()
    if verdict.succeeded and not result.steps and query.context.system.follows_presence:
        return result  # A robot that did not move has learned nothing about open edges.
    if source is not None and usable:
        yield from learn_from_attempt(query, attempt, segment, node_match, verdict, result)
    elif source is not None:
        # So that it is not driven without end; the map stays as it is.
        query.record_failures(itertools.pairwise(segment))
    elif query.context.system.follows_presence and result.end in e.OBSTRUCTED_ENDS:
        query.doubted.add(target)  # The way to the target is blocked, so the robot is probably not there.
    return result


def _ended(
    query: QueryState, attempt: int, source: NodeId | None, target: NodeId, end: e.AttemptEnd, verdict: AttemptVerdict
) -> e.AttemptEnded:
    seen = query.perception.node_match(target)
    attempted = query.number, attempt, source, target, query.perception.observation.step, end
    return e.AttemptEnded(*attempted, seen.distance, seen.reachability, verdict.succeeded, verdict.reason, verdict.rule)


def _ends(segment: Sequence[NodeId]) -> tuple[NodeId | None, NodeId]:
    """Return the source and the target of an attempt; an approach of a single node has no source."""
    source = None if len(segment) == 1 else segment[0]
    return source, segment[-1]
