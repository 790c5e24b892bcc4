"""Did the attempt succeed, is this the goal: verdicts with their reasons, as pure functions.

Owns the rules, and that what resembles the goal must do so from a second pose too. The network that made a false edge
also says "arrived" at its end, so the robust rules ask for evidence of another kind: how far odometry went, and whether
the edge was driven too often already.
"""

from typing import NamedTuple

import numpy as np

from ltvn_core.config import JudgingConfig, Method
from ltvn_core.geometry import distance, relative
from ltvn_core.graph.localiser import fits_trail
from ltvn_core.navigation.context import NavigationContext
from ltvn_core.navigation.dead_reckoning import DeadReckoning
from ltvn_core.navigation.events import Note, Severity
from ltvn_core.navigation.motion import EventGenerator, MotionExecutor
from ltvn_core.navigation.perception import NodeMatch, Perception
from ltvn_core.navigation.query_memory import QueryMemory
from ltvn_core.types import NodeId, Pose, Waypoint

_RECHECK_TURN_RAD = 0.26
_PLAN_GAP_M, _PLAN_GAP_RAD = 0.8, 0.6
"""The goal may be so far from where the plan puts it,"""
_GAP_PER_EDGE_M, _GAP_PER_EDGE_RAD = 0.06, 0.04
"""and so much farther for each edge that the plan had left."""
_MAX_REJECTIONS = 4
"""After so many disagreeing second observations in one query, the first one is believed."""


class GoalCheck:
    """Asks whether the robot is at the goal of a query."""

    def __init__(
        self,
        context: NavigationContext,
        motion: MotionExecutor,
        perception: Perception,
        goal: NodeId,
        memory: QueryMemory,
        reckoning: DeadReckoning,
    ) -> None:
        """Ask for `goal`; where it only seemed to be, `memory` forgets the plan that led there.

        `reckoning` knows where a goal is that cannot be recognised any more.
        """
        self._reckoning = reckoning
        self._context = context
        self._judging = context.method.judging
        self._motion = motion
        self._perception = perception
        self._goal = goal
        self._memory = memory

    def check(self) -> EventGenerator[bool]:
        """Tell whether this is the goal; the robust method observes twice, and checks the way here."""
        first = self._perception.node_match(self._goal)
        if not is_at_goal(first.reachability, first.waypoint, self._judging):
            return self._reckoning.is_at(self._goal)
        if self._perception.with_node_support(self._goal).reachability <= self._judging.success_reachability:
            return False
        if not self._fits_plan(first):
            text = "It looked like the goal, but by the plan the goal is somewhere else."
            yield Note(text, Severity.WARN, rule="judging.by_plan")
            return False
        if not self._fits_trail(first):
            self._memory.plan = ()
            text = "It looked like the goal, but what it saw on the way here does not fit."
            yield Note(text, Severity.WARN, rule="localising.trail_share")
            return False
        if not self._judging.second_look or self._memory.goal_rejections >= _MAX_REJECTIONS:
            return True
        return (yield from self._confirm_from_aside(first))

    def _fits_plan(self, goal: NodeMatch) -> bool:
        """Tell whether the goal is about where the plan puts it, which knows rooms apart that look alike."""
        expected = self._memory.expected_goal
        if not self._judging.by_plan or expected is None:
            return True
        gap = relative(relative(self._motion.odometry, expected.pose), goal.waypoint)
        allowed_m = _PLAN_GAP_M + _GAP_PER_EDGE_M * expected.edges
        allowed_rad = _PLAN_GAP_RAD + _GAP_PER_EDGE_RAD * expected.edges
        return bool(np.hypot(gap[0], gap[1]) <= allowed_m and abs(gap[2]) <= allowed_rad)

    def _fits_trail(self, goal: NodeMatch) -> bool:
        config = self._context.method.localising
        return goal.by_view or fits_trail(
            self._context.loop_closures, self._perception.trail_from_here, self._goal, goal.waypoint, config
        )

    def _confirm_from_aside(self, first: NodeMatch) -> EventGenerator[bool]:
        # The next time it turns to the other side, where there may be more to see.
        aside = _RECHECK_TURN_RAD * (-1) ** self._memory.goal_rejections
        odometry = self._motion.odometry
        yield from self._turn(aside)
        if not (yield from self._perception.can_compare()):
            return (yield from self._look_back_from(aside))
        second = self._perception.node_match(self._goal)
        if goal_estimates_agree(first.waypoint, odometry, second.waypoint, self._motion.odometry):
            yield from self._turn(-aside)
            return True
        self._memory.goal_rejections += 1
        self._memory.plan = ()
        text = "It looked like the goal, but a second look from a little aside disagreed."
        yield Note(text, Severity.WARN, rule="judging.second_look")
        return False

    def _look_back_from(self, aside: float) -> EventGenerator[bool]:
        """Turn back from where the image has no depth; the next time the other side is tried."""
        self._memory.goal_rejections += 1
        yield from self._turn(-aside)
        return False

    def _turn(self, angle_rad: float) -> EventGenerator[None]:
        yield from self._motion.turn(angle_rad, self._context.method.driving.turn_rad_s)


class AttemptVerdict(NamedTuple):
    """Whether an attempt succeeded, and which rule decided."""

    succeeded: bool
    reason: str
    hindered: bool = False
    """It failed, but that says little about the edge."""
    rule: str = ""
    """Name of that rule in `config`; empty where it has none."""


def judge_attempt(
    reachability: float,
    target_distance: float,
    odometry_error: Waypoint,
    method: Method,
    *,
    fits_trail: bool = True,
    hindered: bool = False,
    driven_too_often: bool = False,
) -> AttemptVerdict:
    """Judge an attempt by its target seen from the arrival image, and by where odometry puts the waypoint (3,).

    `fits_trail`: the target may be there after all that was seen on the way. `hindered`: something stood in the way.
    `driven_too_often`: the robot drove here too often to be getting anywhere.
    """
    judging = method.judging
    within = judging.success_distance or method.building.connect_distance
    needed = judging.success_reachability if judging.success_distance else method.building.connect_reachability
    gap = float(distance(odometry_error))
    if reachability <= needed:
        # Where it looks as near as odometry says, the target is probably there and merely hard to recognise.
        at_target = max(target_distance, gap) < _AT_TARGET_DISTANCE
        why = f"target does not look reachable: r = {reachability:.2f}, needs {needed:.2f}"
        return AttemptVerdict(False, why, hindered or at_target, rule=_SUCCESS_REACHABILITY)
    if target_distance >= within:
        why = f"target is still too far: d = {target_distance:.2f}, needs {within:.2f}"
        return AttemptVerdict(False, why, hindered, rule=_SUCCESS_DISTANCE)
    if 0 < judging.odometry_gap < gap:
        why = f"odometry ended {gap:.2f} from the waypoint, at most {judging.odometry_gap:.2f}"
        return AttemptVerdict(False, why, hindered, rule="judging.odometry_gap")
    if not fits_trail:
        why = "what was seen on the way does not fit the target"
        return AttemptVerdict(False, why, rule="localising.trail_share")
    if driven_too_often:
        return AttemptVerdict(False, "driven too often in this query", hindered=True, rule="planning.repeat_limit")
    why = f"target is near: d = {target_distance:.2f}, r = {reachability:.2f}"
    return AttemptVerdict(True, why, rule=_SUCCESS_DISTANCE)


def is_at_goal(reachability: float, waypoint: Waypoint, config: JudgingConfig) -> bool:
    """Tell whether the goal at `waypoint` (3,) is reached."""
    return bool(
        reachability > config.arrive_reachability
        and distance(waypoint) < config.arrive_distance
        and abs(waypoint[2]) <= config.arrive_yaw_rad
    )


def goal_estimates_agree(first: Waypoint, first_odometry: Pose, second: Waypoint, second_odometry: Pose) -> bool:
    """Tell whether two observations from two odometry poses (3,) put the goal at one place."""
    # The goal seen from the first place, as it must look from the second.
    moved = relative(first_odometry, second_odometry)
    gap = relative(relative(moved, first), second)
    return bool(np.hypot(gap[0], gap[1]) < _AGREE_M and abs(gap[2]) < _AGREE_RAD)


_SUCCESS_DISTANCE, _SUCCESS_REACHABILITY = "judging.success_distance", "judging.success_reachability"
_AT_TARGET_DISTANCE = 0.3
"""A target nearer than this d is here."""
_AGREE_M = 0.3
_AGREE_RAD = 0.25
