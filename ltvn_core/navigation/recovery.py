"""Recovery of a robot that is lost or has no path: it looks around, moves on a little, and finally gives up.

Owns the order of these steps and when an unrecognised image is offered to the map.
"""

from collections.abc import Iterator

from ltvn_core.graph.maintenance import UnrecognisedObservation
from ltvn_core.navigation.attempt_driver import AttemptDriver
from ltvn_core.navigation.context import NavigationContext
from ltvn_core.navigation.events import Event, Outcome, Tick
from ltvn_core.navigation.motion import EventGenerator, MotionExecutor, QueryAborted
from ltvn_core.navigation.perception import Perception
from ltvn_core.navigation.query_memory import QueryMemory


class Recovery:
    """Recovers the robot in one query."""

    def __init__(
        self,
        context: NavigationContext,
        motion: MotionExecutor,
        perception: Perception,
        driver: AttemptDriver,
        memory: QueryMemory,
        query: int,
    ) -> None:
        """Recover with `driver`, given the `memory` of the query."""
        self._context = context
        self._config = context.method.recovering
        self._motion = motion
        self._perception = perception
        self._driver = driver
        self._memory = memory
        self._query = query

    def recover(self, why: Outcome) -> EventGenerator[None]:
        """Turn on the spot to look again; after a full turn, also move on a little; finally give up.

        Raises:
            QueryAborted: If the robot has looked around often enough.
        """
        memory = self._memory
        usable = self._perception.is_usable
        memory.record_localisation_failure(why)
        if why is Outcome.LOST and usable:
            yield from self._remember_novel()
        if memory.consecutive_failures >= self._config.give_up_after_looks:
            raise QueryAborted(memory.give_up_outcome)
        around = memory.consecutive_failures % self._config.looks_per_turn == 0
        if around:
            # The robot may be wrong about its way here, about doubted nodes, and about closed edges.
            self._perception.trail.clear()
            memory.begin_anew()
        if self._config.wander_m and around and usable:
            yield from self._driver.wander(self._config.wander_m)
        yield from self.turn()

    def turn_to_see(self) -> EventGenerator[None]:
        """Turn as a lost robot does, but keep the plan, because localisation searches around it first."""
        plan = self._memory.plan
        self._memory.assumed_node = None  # After a turn the robot is no longer at the assumed node.
        yield from self.recover(Outcome.LOST)
        self._memory.plan = plan

    def turn(self) -> Iterator[Event | Tick]:
        """Turn on the spot towards the direction of the next observation."""
        yield from self._driver.turn(self._config.turn_rad)

    def _remember_novel(self) -> Iterator[Event]:
        """Offer an unrecognised image to the system, which may make it a node."""
        context = self._context
        seen = self._perception.observation
        unrecognised = UnrecognisedObservation(seen, self._perception.features, self._memory.consecutive_failures)
        deltas = context.system.maintenance.unrecognised(context.graph, unrecognised, context.matcher)
        if deltas:
            context.keyframes.add([seen], self._perception.features)
            yield from context.apply_deltas(deltas, self._query)
