"""One query under way: the loop of the paper, in the order in which it happens.

Owns that order and the events that tell about it. The decisions are elsewhere: in the strategies of `graph.system`, in
`graph.planner`, `nav.legs` and `nav.judgement`.
"""

import itertools
from collections.abc import Iterator

import numpy as np

from ltvn_core.geometry import compose, relative
from ltvn_core.graph.localizer import LOCAL, Fix, Recall, on_the_way
from ltvn_core.graph.maintenance import Attempt, Lost
from ltvn_core.graph.operators import pose_row
from ltvn_core.graph.planner import Path
from ltvn_core.nav.arrival import Arrival
from ltvn_core.nav.body import Body, QueryOver, Steps
from ltvn_core.nav.events import (
    Event,
    LegEnd,
    LegEnded,
    LegStarted,
    Localised,
    NavigatorState,
    Outcome,
    Planned,
    StateChanged,
    Tick,
)
from ltvn_core.nav.eyes import Eyes, Sight
from ltvn_core.nav.judgement import Verdict, judge_attempt
from ltvn_core.nav.legs import Leg, LegResult
from ltvn_core.nav.memory import QueryMemory
from ltvn_core.nav.mind import Mind
from ltvn_core.types import NodeId, Twist

_CLOSE = 0.3
"""A node nearer than this d need not be approached once more."""
_HINDERED = (LegEnd.BLOCKED, LegEnd.COLLISION, LegEnd.TIMEOUT)
"""A leg that ended so tells of what stands around, not of the edge."""


class Task:
    """Goes to one node."""

    def __init__(self, mind: Mind, body: Body, eyes: Eyes, goal: NodeId, query: int) -> None:
        """Begin a query that nothing is known of yet."""
        self._mind, self._method = mind, mind.method
        self._body, self._eyes = body, eyes
        self._goal, self._query = goal, query
        self._memory = QueryMemory(mind.method.planning, mind.method.localising)
        self._leg = Leg(body, eyes, mind.method.driving, mind.intrinsics)
        self._arrival = Arrival(mind, body, eyes, goal, self._memory)
        self._state = NavigatorState.IDLE

    def run(self) -> Steps[Outcome]:
        """Localise, plan, drive, judge, update, until the goal is reached or hope is lost."""
        while True:
            if (yield from self._arrival.arrived()):
                return Outcome.ARRIVED
            fix = yield from self._localise()
            if fix.node is None:
                yield from self._recover(Outcome.LOST)
                continue
            path = yield from self._plan(fix.node)
            if not path.nodes:
                yield from self._recover(Outcome.NO_PATH)
                continue
            self._memory.looks_in_vain = 0
            if (yield from self._follow(fix, path)):
                return Outcome.ARRIVED

    def _localise(self) -> Steps[Fix]:
        """Find the node the robot is at."""
        yield from self._enter(NavigatorState.LOCALISING)
        held = self._memory.take_held()
        if held is not None and held in self._mind.graph.nodes:
            sight = self._eyes.sight(held)
            fix = Fix(held, sight.distance, sight.reachability, sight.waypoint, None, np.inf, LOCAL)
        else:
            mind = self._mind
            image = self._eyes.features
            recall = Recall(self._memory.plan, self._eyes.way_here, self._memory.doubted)
            fix = mind.system.localise(image, mind.graph, recall, mind.matcher)
        frame = self._eyes.observation.step
        numbers = fix.distance, fix.reachability, fix.runner_up, fix.margin, fix.scope
        yield Localised(self._query, frame, fix.node, *numbers)
        return fix

    def _plan(self, start: NodeId) -> Steps[Path]:
        """Find the cheapest path; where there is none, the system may extend the map."""
        yield from self._enter(NavigatorState.PLANNING)
        mind = self._mind
        path = mind.planner.plan(start, self._goal, self._memory.penalties)
        if not path.nodes and self._memory.may_expand(start):
            deltas = mind.system.maintenance.no_path(mind.graph, start, self._goal, mind.matcher, mind.rng)
            yield from mind.change(deltas, self._query)
            path = mind.planner.plan(start, self._goal, self._memory.penalties)
        self._memory.plan = path.nodes
        yield Planned(self._query, path.nodes, path.cost)
        return path

    def _follow(self, fix: Fix, path: Path) -> Steps[bool]:
        """Drive to the subgoal; tell whether the robot stands at the goal with nothing left to drive."""
        stretch = self._stretch(path)
        sight = self._departure(fix, stretch)
        if sight is None:
            stretch = stretch[:1]
            sight = self._eyes.sight(stretch[0])
        source, target = _ends(stretch)
        self._memory.approached = target if source is None else None
        result = yield from self._drive(stretch, sight)
        if result.steps:
            return False
        yield from self._body.move_on()
        if result.end is LegEnd.BLOCKED:
            # From the same place it would be blocked again, so the robot looks for another way from aside.
            yield from self._turn(self._method.recovering.turn_rad)
            return False
        # A leg of no step would be planned again for ever, so the robot is held to have arrived.
        self._memory.held_at = target
        return source is None and target == self._goal

    def _stretch(self, path: Path) -> tuple[NodeId, ...]:
        """Return the path up to the subgoal; at the goal already, it is the goal alone."""
        if len(path.nodes) == 1:
            return path.nodes
        chosen = self._mind.system.subgoal(path.nodes, lambda node: self._eyes.sight(node).reachability)
        return path.nodes[: chosen + 1]

    def _departure(self, fix: Fix, stretch: tuple[NodeId, ...]) -> Sight | None:
        """Return the target as seen from here; None if the robot had better go to the node it is at first."""
        source, target = _ends(stretch)
        sight, driving = self._eyes.sight(target), self._method.driving
        if source is None or sight.reachability >= driving.departure_reachability:
            return sight
        if fix.distance > _CLOSE and self._memory.approached != source:
            return None
        if not driving.through_map:
            return sight
        aim = fix.waypoint
        for edge in itertools.pairwise(stretch):
            aim = compose(aim, np.array(self._mind.graph.edges[edge].waypoint))
        return sight.aimed(aim)

    def _drive(self, stretch: tuple[NodeId, ...], sight: Sight) -> Steps[LegResult]:
        """Drive one leg and learn from it."""
        source, target = _ends(stretch)
        yield from self._enter(NavigatorState.DRIVING)
        attempt, frame = next(self._mind.attempts), self._eyes.observation.step
        yield LegStarted(self._query, attempt, source, target, frame, pose_row(sight.waypoint), sight.reachability)
        try:
            result = yield from self._leg.drive(target, sight.waypoint)
        except QueryOver as over:
            end = LegEnd.CANCELLED if over.outcome is Outcome.CANCELLED else LegEnd.TIMEOUT
            yield self._ended(attempt, source, target, end, Verdict(False, f"cut short: {over.outcome.value}"))
            raise
        yield from self._enter(NavigatorState.JUDGING)
        verdict = self._judge(source, target, result)
        yield self._ended(attempt, source, target, result.end, verdict)
        if source is not None:
            yield from self._learn(attempt, stretch, sight, verdict)
        return result

    def _judge(self, source: NodeId | None, target: NodeId, result: LegResult) -> Verdict:
        worn_out = source is not None and self._memory.drove((source, target))
        seen, left = self._eyes.sight(target), relative(self._body.odometry, result.goal)
        return judge_attempt(
            seen.reachability,
            seen.distance,
            left,
            self._method,
            fits=self._fits_the_way(target, seen),
            hindered=result.end in _HINDERED,
            worn_out=worn_out,
        )

    def _fits_the_way(self, target: NodeId, seen: Sight) -> bool:
        config = self._method.localising
        return on_the_way(self._mind.closures, self._eyes.way_here, target, seen.waypoint, config, to_blame=True)

    def _learn(self, attempt: int, stretch: tuple[NodeId, ...], sight: Sight, verdict: Verdict) -> Iterator[Event]:
        """Remember a failure for this query, and let the system update the map."""
        edges, mind = list(itertools.pairwise(stretch)), self._mind
        failed_before = any(self._memory.failed(edge) for edge in edges)
        if not verdict.succeeded:
            for edge in edges:  # Nobody knows which of them is to blame.
                self._memory.fail(edge)
            self._memory.fail_from(stretch[0])
        told = verdict.succeeded, failed_before, verdict.hindered
        evidence = Attempt(stretch[0], stretch[-1], sight.distance, *told)
        yield from mind.change(mind.system.maintenance.after_attempt(mind.graph, evidence), self._query, attempt)

    def _ended(self, attempt: int, source: NodeId | None, target: NodeId, end: LegEnd, verdict: Verdict) -> LegEnded:
        seen, frame = self._eyes.sight(target), self._eyes.observation.step
        numbers = seen.distance, seen.reachability, verdict.succeeded, verdict.reason
        return LegEnded(self._query, attempt, source, target, frame, end, *numbers)

    def _recover(self, why: Outcome) -> Steps[None]:
        """Turn on the spot to look again; after a full turn move on a little; in the end give up."""
        yield from self._enter(NavigatorState.RECOVERING)
        recovering, memory = self._method.recovering, self._memory
        memory.look_in_vain(why)
        if why is Outcome.LOST:
            yield from self._remember_novel()
        if memory.looks_in_vain >= recovering.give_up_after_looks:
            raise QueryOver(memory.despair)
        ahead = Twist(self._method.driving.speed_m_s / 2, 0.0)
        around = memory.looks_in_vain % recovering.looks_per_turn == 0
        if around:
            # Perhaps it was wrong about the way here, and about where it is not.
            self._eyes.trail.forget()
            memory.trust_again()
        if around and recovering.wander_m and self._leg.cleared(ahead, recovering.wander_m) == ahead:
            yield from self._body.advance(recovering.wander_m, ahead.linear_m_s)
        yield from self._turn(recovering.turn_rad)

    def _remember_novel(self) -> Iterator[Event]:
        """Let the system make a node of what nobody recognised."""
        mind, seen = self._mind, self._eyes.observation
        lost = Lost(seen, self._eyes.features, self._memory.looks_in_vain, self._eyes.way_here)
        deltas = mind.system.maintenance.lost(mind.graph, lost, mind.matcher)
        if deltas:
            mind.views.add([seen], self._eyes.features)
            yield from mind.change(deltas, self._query)

    def _turn(self, angle_rad: float) -> Iterator[Event | Tick]:
        yield from self._body.turn(angle_rad, self._method.driving.turn_rad_s)

    def _enter(self, state: NavigatorState) -> Iterator[Event]:
        if state is not self._state:
            self._state = state
            yield StateChanged(state)


def _ends(stretch: tuple[NodeId, ...]) -> tuple[NodeId | None, NodeId]:
    """Return where a leg begins and ends; to a single node the robot only makes its approach."""
    source = None if len(stretch) == 1 else stretch[0]
    return source, stretch[-1]
