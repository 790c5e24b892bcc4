"""Is this the goal? What looks like it must look so from aside too, and fit to what was seen on the way there.

Owns the order of these questions. The rules are `nav.judgement` and `graph.closures`.
"""

from ltvn_core.graph.localizer import on_the_way
from ltvn_core.nav.body import Body, Steps
from ltvn_core.nav.events import Note, Severity
from ltvn_core.nav.eyes import Eyes, Sight
from ltvn_core.nav.judgement import agree, is_at_goal
from ltvn_core.nav.memory import QueryMemory
from ltvn_core.nav.mind import Mind
from ltvn_core.types import NodeId

_SECOND_LOOK_RAD = 0.26
_DENIALS = 4
"""So often a second look may disagree in one query; a goal seen so often is taken for what it looks like."""


class Arrival:
    """Asks whether the robot is at the goal of a query."""

    def __init__(self, mind: Mind, body: Body, eyes: Eyes, goal: NodeId, memory: QueryMemory) -> None:
        """Ask for `goal`; where it only seemed to be, `memory` forgets the plan that led there."""
        self._mind, self._judging = mind, mind.method.judging
        self._body, self._eyes, self._goal, self._memory = body, eyes, goal, memory

    def arrived(self) -> Steps[bool]:
        """Tell whether this is the goal; the robust method looks twice, and asks how it came here."""
        first = self._eyes.sight(self._goal)
        if not is_at_goal(first.reachability, first.waypoint, self._judging):
            return False
        if self._eyes.witnessed(self._goal).reachability <= self._judging.success_reachability:
            return False
        if not self._fits_the_way(first):
            self._memory.plan = ()
            yield Note("It looked like the goal, but what it saw on the way here does not fit.", Severity.WARN)
            return False
        if not self._judging.second_look or self._memory.denials >= _DENIALS:
            return True
        return (yield from self._looks_so_from_aside(first))

    def _fits_the_way(self, goal: Sight) -> bool:
        config = self._mind.method.localising
        return on_the_way(self._mind.closures, self._eyes.way_here, self._goal, goal.waypoint, config)

    def _looks_so_from_aside(self, first: Sight) -> Steps[bool]:
        # The next time it looks to the other side, where there may be more to see.
        aside, odometry = _SECOND_LOOK_RAD * (-1) ** self._memory.denials, self._body.odometry
        yield from self._turn(aside)
        second = self._eyes.sight(self._goal)
        if agree(first.waypoint, odometry, second.waypoint, self._body.odometry):
            yield from self._turn(-aside)
            return True
        self._memory.denials += 1
        self._memory.plan = ()
        yield Note("It looked like the goal, but a second look from a little aside disagreed.", Severity.WARN)
        return False

    def _turn(self, angle_rad: float) -> Steps[None]:
        yield from self._body.turn(angle_rad, self._mind.method.driving.turn_rad_s)
