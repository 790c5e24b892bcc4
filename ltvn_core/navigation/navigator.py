"""The navigator: from a goal node to a stream of events and ticks.

Owns the start and the end of a query, and always stops the robot afterwards. The query itself is in
`navigation.query_runner`. A query is a generator: it yields events, and a `Tick` whenever the caller should let one
control step of 0.1 s pass.
"""

from collections.abc import Callable, Generator
from contextlib import closing
from dataclasses import replace

import numpy as np

from ltvn_core.errors import MapError
from ltvn_core.geometry import distance, relative
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.matching import Matcher
from ltvn_core.graph.navigation_system import NavigationSystem
from ltvn_core.graph.place_belief import SURE
from ltvn_core.graph.planner import Planner
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.graph.wheel_slips import SlipTracker
from ltvn_core.navigation.action_performer import ActionPerformer
from ltvn_core.navigation.arrival import Arrival
from ltvn_core.navigation.bystanders import Bystanders
from ltvn_core.navigation.events import Event, NavigatorState, Outcome, QueryEnded, QueryStarted, StateChanged, Tick
from ltvn_core.navigation.perception import MotionExecutor, Perception, PlaceTracker, QueryAborted
from ltvn_core.navigation.query import NavigationContext, QueryState
from ltvn_core.navigation.query_runner import run
from ltvn_core.robots.robot import Robot
from ltvn_core.types import CONTROL_STEP_S, NodeId, Pose, Predictor

_STOOD = 0.2
"""Greatest d by odometry between two queries of a robot that stood meanwhile: it still knows its place."""


class Navigator:
    """Drives a robot to goal nodes of a map, and updates the map on the way."""

    def __init__(
        self,
        robot: Robot,
        graph: TopologicalGraph,
        keyframes: KeyframeStore,
        predictor: Predictor,
        system: NavigationSystem,
        rng: np.random.Generator,
        *,
        bystanders: Bystanders | None = None,
        world_time: Callable[[], float] | None = None,
        actions: ActionPerformer | None = None,
    ) -> None:
        """Navigate in `graph`, with its images in `keyframes`; maintenance changes both on the way.

        `bystanders` are the people that the robot met before, under another navigator.
        `world_time` returns the time of the world in seconds, if the robot's clock does not show it.
        `actions` performs the actions of edges; without it, each action fails.
        """
        self._robot = robot
        self._predictor = predictor
        self._slips = SlipTracker(robot.spec.camera) if system.method.matching.mend_slips else None
        self._context = NavigationContext(
            graph=graph,
            keyframes=keyframes,
            system=system,
            rng=rng,
            spec=robot.spec,
            matcher=Matcher(predictor, keyframes, system.method.matching),
            planner=Planner(graph, system.method.planning, weight=system.edge_weight),
            bystanders=bystanders or Bystanders(),
            world_time=world_time,
            actions=actions,
        )
        self._motion: MotionExecutor | None = None
        self._arrived: tuple[PlaceTracker, Pose] | None = None
        """The belief of a robot that arrived and was sure of its place, and its odometry pose (3,) there."""

    def query(self, goal: NodeId, query: int) -> Generator[Event | Tick, None, None]:
        """Drive to a node: yield events, and ticks at which the caller lets time pass.

        Closing the iterator stops the robot at once and yields nothing more; `cancel` ends the query with its events.
        Raises MapError at once if the goal is not in the map.
        """
        if goal not in self._context.graph.nodes:
            count = len(self._context.graph.nodes)
            raise MapError(f"Node {goal} is not in the map, which has {count} nodes; choose one of them as the goal.")
        return self._query(goal, query)

    def drive_to(self, goal: NodeId, *, query: int = 0, consume: Callable[[Event], None] | None = None) -> QueryEnded:
        """Drive to a node, let the robot's clock run meanwhile, and return how the query ended.

        Args:
            goal: Node to drive to.
            query: Number of the query in its events.
            consume: Called with each event of the query; it may call `cancel`.

        Raises:
            MapError: The goal is not in the map.
        """
        with closing(self.query(goal, query)) as events:
            for event in events:
                if isinstance(event, Tick):
                    self._robot.clock.advance(CONTROL_STEP_S)
                    continue
                if consume is not None:
                    consume(event)
                if isinstance(event, QueryEnded):
                    return event
        raise AssertionError("a query that is not closed ends with its event")

    def cancel(self) -> None:
        """End the running query at its next control step."""
        if self._motion is not None:
            self._motion.cancelled = True

    def _query(self, goal: NodeId, query: int) -> Generator[Event | Tick, None, None]:
        context = self._context
        limits = context.system.method.recovering
        motion = self._motion = MotionExecutor(self._robot, query, limits, slips=self._slips)
        perception = Perception(motion, self._predictor, context.matcher)
        try:
            yield QueryStarted(query, goal)
            arrival: Arrival | None = None
            state = QueryState(context, motion, perception, goal, query)
            if self._arrived is not None and distance(relative(self._arrived[1], motion.odometry)) < _STOOD:
                state.places = perception.places = self._arrived[0]
            self._arrived = None
            try:
                arrival = yield from run(state)
                outcome = Outcome.ARRIVED
                if (state.place_p() or 0.0) > SURE:
                    self._arrived = state.places, motion.odometry.copy()
            except QueryAborted as over:
                outcome = over.outcome
            self._robot.stop()
            yield StateChanged(NavigatorState.IDLE)
            ended = QueryEnded(query, goal, outcome, motion.steps, motion.collisions, motion.path_m)
            yield ended if arrival is None else replace(ended, **arrival._asdict())
        finally:
            self._robot.stop()
            self._motion = None
