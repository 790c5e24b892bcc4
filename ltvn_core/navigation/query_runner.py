"""Runs one query: the navigation loop of the paper (Section III), step by step.

Owns the order of the steps and the events that report them. The decisions are elsewhere: in the strategies of
`graph.navigation_system`, in `graph.planner`, `navigation.attempt_driver` and `navigation.judgement`.
"""

import itertools
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
from ltvn_core.navigation.query import Query
from ltvn_core.navigation.recovery import LOOKS_PER_TURN, recover, turn, turn_to_see
from ltvn_core.navigation.way_planner import plan_way, way_exists
from ltvn_core.types import NodeId, Waypoint

_AT_NODE_DISTANCE = 0.3
"""Greatest d at which a node is not approached before its successor."""
_AT_START_M = 0.1
"""Driven distance up to which the robot is where it began to localise, in metres."""
_INCONCLUSIVE_ENDS = (AttemptEnd.BLOCKED, AttemptEnd.COLLISION, AttemptEnd.TIMEOUT)
"""Ends of attempts that say something about the surroundings, not about the edge."""


class QueryRunner:
    """Drives the robot to the goal of a query."""

    def __init__(self, query: Query) -> None:
        """Start with a robot that knows nothing about its place."""
        self._query = query
        self._memory = query.memory
        self._perception = query.perception
        self._motion = query.motion
        self._context = query.context
        self._reached: NodeId | None = None
        self._state = NavigatorState.IDLE

    def run(self) -> EventGenerator[Arrival]:
        """Localise, plan, drive, judge, update, until the goal is reached; return how the robot knows.

        Raises:
            QueryAborted: The query was given up, or a person cancelled it.
        """
        while True:
            if (yield from self._perception.can_compare()) and (arrival := (yield from check_goal(self._query))):
                return arrival
            if not self._perception.is_usable:
                yield from self._enter(NavigatorState.RECOVERING)
                yield from turn_to_see(self._query)
                continue
            localisation = yield from self._localise()
            if localisation.node is None:
                yield from self._recover(Outcome.LOST)
                continue
            path = yield from self._plan(localisation.node)
            if not path.nodes:
                yield from self._recover(Outcome.NO_PATH)
                continue
            self._memory.consecutive_failures = 0
            if self._looks_first():
                yield from turn(self._query)
                continue
            driven = self._until_action(path)
            if len(driven.nodes) == 1 < len(path.nodes) and self._stands_at_node(localisation):
                yield from self._act(path.nodes[0], path.nodes[1])
            elif arrival := (yield from self._follow(localisation, driven)):
                return arrival

    def _looks_first(self) -> bool:
        """Tell whether to turn before driving off, because the first images show several places."""
        p = self._query.place_p()
        if p is None or p > LIKELY or self._motion.path_m - self._memory.began_at_m > _AT_START_M:
            return False
        self._memory.first_looks += 1
        return self._memory.first_looks <= LOOKS_PER_TURN

    def _localise(self) -> EventGenerator[Localisation]:
        """Find the node the robot is at."""
        yield from self._enter(NavigatorState.LOCALISING)
        assumed = self._memory.take_assumed_node()
        if assumed is not None and assumed in self._context.graph.nodes:
            localisation = self._localisation_at(assumed)
        else:
            context = self._context
            features = self._perception.features
            prior = LocalisationPrior(self._memory.plan, self._memory.doubted, self._query.place())
            localisation = context.system.localise(features, context.graph, prior, context.matcher)
        frame = self._perception.observation.step
        yield Localised(
            query=self._query.number,
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

    def _localisation_at(self, node: NodeId) -> Localisation:
        """Return a localisation at a given node, with its waypoint from the place belief, or else from the image."""
        match = self._perception.node_match(node)
        known = self._query.known_waypoint(node, LIKELY)
        match = match if known is None else match.with_waypoint(known)
        return Localisation(node, match.distance, match.reachability, match.waypoint, None, np.inf, LOCAL)

    def _plan(self, start: NodeId) -> EventGenerator[GraphPath]:
        """Find the cheapest path; if there is none, let the system extend the map."""
        yield from self._enter(NavigatorState.PLANNING)
        context = self._context
        query = self._query
        path = plan_way(query, start)
        if not path.nodes and not way_exists(query, start) and self._memory.should_expand_from(start):
            yield from query.apply(
                context.system.maintenance.no_path(context.graph, start, query.goal, context.matcher, context.rng)
            )
            path = plan_way(query, start)
        self._memory.plan = path.nodes
        yield Planned(query.number, path.nodes, path.cost, query.place_p())
        return path

    def _until_action(self, path: GraphPath) -> GraphPath:
        """Return the beginning of a path that can be driven, up to the next edge with an action."""
        edges = self._context.graph.edges
        for count, edge in enumerate(itertools.pairwise(path.nodes), 1):
            if edges[edge].action:
                return path._replace(nodes=path.nodes[:count])
        return path

    def _stands_at_node(self, localisation: Localisation) -> bool:
        """Tell whether the robot is close enough to its node to need no approach."""
        node = localisation.node
        known = None if node is None else self._query.known_waypoint(node, SURE)
        is_there = known is not None and np.hypot(known[0], known[1]) < AT_TARGET_M
        return is_there or localisation.distance <= _AT_NODE_DISTANCE or self._reached == node

    def _act(self, source: NodeId, target: NodeId) -> EventGenerator[None]:
        """Run the action of an edge; afterwards the robot is at the edge's target, though its wheels did not move."""
        yield from self._enter(NavigatorState.ACTING)
        edge = (source, target)
        self._reached = None
        succeeded = yield from run_action(self._query, edge)
        if not succeeded or self._memory.count_drive(edge):
            self._memory.close(edge)
        if succeeded:
            self._memory.arrive_elsewhere(target)
            self._query.forget_odometry()
            self._query.places.begin_at(target, self._motion.odometry)

    def _follow(self, localisation: Localisation, path: GraphPath) -> EventGenerator[Arrival | None]:
        """Drive to the subgoal; return the arrival if nothing is left to drive because the robot is at the goal."""
        segment = self._subgoal_segment(path)
        node_match = self._departure(localisation, segment)
        if node_match is None:
            segment = segment[:1]
            node_match = self._perception.node_match(segment[0])
        source, target = _ends(segment)
        self._memory.approached = target if source is None else None
        self._query.departure = departure(self._query, localisation)
        if (yield from look_for_obstacles(self._query, path)):
            yield from self._motion.wait_one_step()
            return None
        result = yield from self._drive(segment, node_match)
        self._reached = target if source is None and result.end is AttemptEnd.REACHED else None
        if result.steps:
            return None
        yield from self._motion.wait_one_step()
        if result.end is AttemptEnd.BLOCKED:
            # The same attempt would be blocked again, so the robot turns to look for another way.
            yield from turn(self._query)
            return None
        if source is None and target == self._query.goal:
            return (yield from check_place(self._query))
        # An attempt without a step would be repeated without end, so the robot counts as being there.
        self._memory.assumed_node = target
        return None

    def _subgoal_segment(self, path: GraphPath) -> tuple[NodeId, ...]:
        """Return the path up to the subgoal; only the goal if the robot is already there."""
        if len(path.nodes) == 1:
            return path.nodes
        chosen = self._context.system.subgoal(path.nodes, lambda node: self._perception.node_match(node).reachability)
        return path.nodes[: chosen + 1]

    def _departure(self, localisation: Localisation, segment: tuple[NodeId, ...]) -> NodeMatch | None:
        """Return the prediction of the target at departure; None if the robot should first approach the node that it is
        at."""
        source, target = _ends(segment)
        node_match = self._perception.node_match(target)
        driving = self._query.method.driving
        if source is None and (surveyed := self._query.surveyed_waypoint(target)) is not None:
            return node_match.with_waypoint(surveyed)
        if source is None and self._query.is_recognised(node_match.reachability):
            return node_match
        known = self._query.known_waypoint(target, LIKELY)
        looks_reachable = node_match.reachability >= driving.departure_reachability
        if known is not None and not (looks_reachable and is_where_expected(known, node_match.waypoint)):
            return node_match.with_waypoint(known)
        if looks_reachable or source is None:
            return node_match
        if localisation.distance > _AT_NODE_DISTANCE and self._memory.approached != source:
            return None
        if not driving.through_map:
            return node_match
        return node_match.with_waypoint(self._along(localisation.waypoint, segment))

    def _along(self, waypoint: Waypoint, nodes: Sequence[NodeId]) -> Waypoint:
        """Return the waypoint (3,) of the last of `nodes`, by the edges from the first one, which is at `waypoint`
        (3,)."""
        for edge in itertools.pairwise(nodes):
            waypoint = compose(waypoint, np.array(self._context.graph.edges[edge].waypoint))
        return waypoint

    def _drive(self, segment: tuple[NodeId, ...], node_match: NodeMatch) -> EventGenerator[AttemptResult]:
        """Make one attempt and learn from it."""
        source, target = _ends(segment)
        yield from self._enter(NavigatorState.DRIVING)
        attempt = next(self._context.attempt_numbers)
        frame = self._perception.observation.step
        yield AttemptStarted(
            self._query.number, attempt, source, target, frame, pose_row(node_match.waypoint), node_match.reachability
        )
        try:
            query = self._query
            known = query.surveyed_waypoint(target) if source is None else query.known_waypoint(target, LIKELY)
            is_known = known is not None or self._is_by_odometry(segment)
            result = yield from self._query.driver.drive(
                target, node_match.waypoint, is_known=is_known, around=self._query.nodes_around(LIKELY)
            )
        except QueryAborted as over:
            end = AttemptEnd.CANCELLED if over.outcome is Outcome.CANCELLED else AttemptEnd.TIMEOUT
            yield self._ended(attempt, source, target, end, AttemptVerdict(False, f"cut short: {over.outcome.value}"))
            raise
        yield from self._enter(NavigatorState.JUDGING)
        verdict = self._judge(segment, result)
        yield self._ended(attempt, source, target, result.end, verdict)
        usable = yield from self._perception.can_compare()
        if verdict.succeeded and not result.steps and self._context.system.follows_presence:
            return result  # A robot that did not move has learned nothing about open edges.
        if source is not None and usable:
            yield from learn_from_attempt(self._query, attempt, segment, node_match, verdict, result)
        elif source is not None:
            self._memory.record_failures(segment)  # So that it is not driven without end; the map stays as it is.
        elif self._context.system.follows_presence and result.end in OBSTRUCTED_ENDS:
            self._memory.doubted.add(target)  # The way to the target is blocked, so the robot is probably not there.
        return result

    def _is_by_odometry(self, segment: Sequence[NodeId]) -> bool:
        """Tell whether a segment has an edge that only odometry supports, so that its two images may show nothing in
        common."""
        return any(self._context.graph.edges[edge].by_odometry for edge in itertools.pairwise(segment))

    def _judge(self, segment: Sequence[NodeId], result: AttemptResult) -> AttemptVerdict:
        source, target = _ends(segment)
        driven_too_often = source is not None and self._memory.count_drive((source, target))
        if not self._perception.is_usable:
            return AttemptVerdict(False, "the last image has no depth, so it cannot be judged", hindered=True)
        seen = self._perception.node_match(target)
        left = relative(self._motion.odometry, result.goal)
        place = self._query.place()
        verdict = judge_attempt(
            seen.reachability,
            seen.distance,
            left,
            self._query.method,
            fits_place=place is None or not place.rules_out(target, seen.waypoint, SURE),
            hindered=result.end in _INCONCLUSIVE_ENDS,
            driven_too_often=driven_too_often,
        )
        is_unsure = not verdict.succeeded and result.end is AttemptEnd.REACHED and not driven_too_often
        known = self._query.known_waypoint(target, SURE) if is_unsure and source is not None else None
        if known is not None and np.hypot(known[0], known[1]) < AT_TARGET_M:
            if not self._query.is_recognised(seen.reachability):
                self._memory.assumed_node = target  # The image does not show the target, only the belief does.
            why = "the images of the whole query say that the robot is there"
            return AttemptVerdict(True, why, rule=BY_PLACE)
        return verdict

    def _ended(
        self, attempt: int, source: NodeId | None, target: NodeId, end: AttemptEnd, verdict: AttemptVerdict
    ) -> AttemptEnded:
        seen = self._perception.node_match(target)
        frame = self._perception.observation.step
        return AttemptEnded(
            query=self._query.number,
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

    def _recover(self, why: Outcome) -> EventGenerator[None]:
        yield from self._enter(NavigatorState.RECOVERING)
        yield from recover(self._query, why)

    def _enter(self, state: NavigatorState) -> Iterator[Event]:
        if state is not self._state:
            self._state = state
            yield StateChanged(state)


def _ends(segment: Sequence[NodeId]) -> tuple[NodeId | None, NodeId]:
    """Return the source and the target of an attempt; an approach of a single node has no source."""
    source = None if len(segment) == 1 else segment[0]
    return source, segment[-1]
