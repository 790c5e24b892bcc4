"""Queries with a robot that is not simulated: time passes by itself, and everything is written down.

Owns the robot's end: it is stopped and closed, whatever happens.
"""

import logging
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from ltvn_core.errors import RobotError
from ltvn_core.evaluation.query_result import QueryResult
from ltvn_core.evaluation.query_run import run_query
from ltvn_core.importing.played_drive import open_robot
from ltvn_core.navigation.events import Event, GraphChanged, StampedEvent
from ltvn_core.recording.recorded_robot import RecordedRobot
from ltvn_core.recording.writer import RecordingWriter
from ltvn_core.robots.robot import Robot, require_drivable
from ltvn_core.robots.robot_view import ContinuedRobot, fit_camera
from ltvn_core.topological_map import TopologicalMap
from ltvn_core.types import CONTROL_STEP_S, NodeId

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


def continued_robot(own: Robot, known: TopologicalMap) -> ContinuedRobot:
    """Return a robot seen through the camera of a map's images, whose steps and stamps go on from theirs."""
    last = known.keyframes.observation(known.keyframes.frames[-1])
    return ContinuedRobot(fit_camera(own, known.predictor.camera), last_step=last.step, last_stamp_s=last.stamp)


class RobotQueries:
    """Drives a robot to nodes of a map, one after the other."""

    def __init__(
        self,
        robot: Robot,
        writer: RecordingWriter,
        known: TopologicalMap,
        rng: np.random.Generator,
    ) -> None:
        """Drive by a map and maintain it as its system does; images and events go to `writer`."""
        self._robot = robot
        self._writer = writer
        self._graph = known.graph
        self._navigator = known.navigator(RecordedRobot(robot, writer), seed=rng)

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
