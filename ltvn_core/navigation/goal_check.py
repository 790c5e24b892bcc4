"""Goal check: what resembles the goal must do so from a second pose too, and fit what was seen on the way there.

Owns the order of these questions. The rules are in `navigation.judgement` and `graph.loop_closures`.
"""

import numpy as np

from ltvn_core.geometry import relative
from ltvn_core.graph.localiser import fits_trail
from ltvn_core.navigation.context import NavigationContext
from ltvn_core.navigation.dead_reckoning import DeadReckoning
from ltvn_core.navigation.events import Note, Severity
from ltvn_core.navigation.judgement import goal_estimates_agree, is_at_goal
from ltvn_core.navigation.motion import EventGenerator, MotionExecutor
from ltvn_core.navigation.perception import NodeMatch, Perception
from ltvn_core.navigation.query_memory import QueryMemory
from ltvn_core.types import NodeId

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
        self._context, self._judging = context, context.method.judging
        self._motion, self._perception, self._goal, self._memory = motion, perception, goal, memory

    def check(self) -> EventGenerator[bool]:
        """Tell whether this is the goal; the robust method observes twice, and checks the way here."""
        first = self._perception.node_match(self._goal)
        if not is_at_goal(first.reachability, first.waypoint, self._judging):
            return self._reckoning.is_at(self._goal)
        if self._perception.with_node_support(self._goal).reachability <= self._judging.success_reachability:
            return False
        if not self._fits_plan(first):
            yield Note("It looked like the goal, but by the plan the goal is somewhere else.", Severity.WARN)
            return False
        if not self._fits_trail(first):
            self._memory.plan = ()
            yield Note("It looked like the goal, but what it saw on the way here does not fit.", Severity.WARN)
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
        aside, odometry = _RECHECK_TURN_RAD * (-1) ** self._memory.goal_rejections, self._motion.odometry
        yield from self._turn(aside)
        if not (yield from self._perception.can_compare()):
            return (yield from self._look_back_from(aside))
        second = self._perception.node_match(self._goal)
        if goal_estimates_agree(first.waypoint, odometry, second.waypoint, self._motion.odometry):
            yield from self._turn(-aside)
            return True
        self._memory.goal_rejections += 1
        self._memory.plan = ()
        yield Note("It looked like the goal, but a second look from a little aside disagreed.", Severity.WARN)
        return False

    def _look_back_from(self, aside: float) -> EventGenerator[bool]:
        """Turn back from where the image has no depth; the next time the other side is tried."""
        self._memory.goal_rejections += 1
        yield from self._turn(-aside)
        return False

    def _turn(self, angle_rad: float) -> EventGenerator[None]:
        yield from self._motion.turn(angle_rad, self._context.method.driving.turn_rad_s)
