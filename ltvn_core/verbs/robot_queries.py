"""Queries with a robot that is not simulated: time passes by itself, and everything is written down.

Owns the robot's end: it is stopped and closed, whatever happens.
"""

import logging
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from ltvn_core.composition import open_robot
from ltvn_core.errors import RobotError
from ltvn_core.evaluation.query_result import QueryResult
from ltvn_core.evaluation.query_run import run_query
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.navigation_system import NavigationSystem
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.navigation.events import Event, GraphChanged, StampedEvent
from ltvn_core.navigation.navigator import Navigator
from ltvn_core.recording.recorded_robot import RecordedRobot
from ltvn_core.recording.writer import RecordingWriter
from ltvn_core.robots.open_loop import require_drivable
from ltvn_core.robots.robot import Robot
from ltvn_core.types import CONTROL_STEP_S, NodeId, Predictor

_LOG = logging.getLogger(__name__)


@contextmanager
def opened_robot(name: str, *, drives: bool = True) -> Iterator[Robot]:
    """Open a robot; it is stopped and closed, whatever happens.

    Raises PluginError, DriveError, RobotError, and OptionError where it `drives` and the robot obeys no command.
    """
    robot = open_robot(name)
    try:
        if drives:
            require_drivable(robot)
        yield robot
    finally:
        robot.stop()
        getattr(robot, "close", lambda: None)()


class RobotQueries:
    """Drives a robot to nodes of a map, one after the other."""

    def __init__(
        self,
        robot: Robot,
        writer: RecordingWriter,
        graph: TopologicalGraph,
        keyframes: KeyframeStore,
        predictor: Predictor,
        system: NavigationSystem,
        rng: np.random.Generator,
    ) -> None:
        """Drive by `graph` and maintain it as `system` does; images and events go to `writer`."""
        self._robot, self._writer, self._graph = robot, writer, graph
        recorded = RecordedRobot(robot, writer)
        self._navigator = Navigator(recorded, graph, keyframes, predictor, system.method, rng, system=system)

    def drive_to(self, goal: NodeId, query: int) -> QueryResult:
        """Run a query in real time and record it. Raises RobotError where the robot is lost; it stands then."""
        try:
            result = run_query(
                self._navigator,
                goal,
                query,
                advance=lambda: self._robot.clock.advance(CONTROL_STEP_S),
                consume=self._record,
            )
        except RobotError as error:
            path = self._writer.path
            raise RobotError(f"{error} The query to node {goal} is over; {path} has what came before.") from error
        _LOG.info("Node %d: %s after %.1f m.", goal, result.outcome, result.path_m)
        self._draw()
        return result

    def _draw(self) -> None:
        state = self._robot.state()
        self._writer.draw_graph(self._graph, state.step, state.stamp)

    def _record(self, event: Event) -> None:
        state = self._robot.state()
        self._writer.write_event(StampedEvent(state.step, state.stamp, event))
        if isinstance(event, GraphChanged):
            self._draw()
