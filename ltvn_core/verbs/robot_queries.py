"""Queries with a robot that is not simulated: time passes by itself, and everything is written down.

Owns the robot's end: it is stopped and closed, whatever happens.
"""

import logging
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from ltvn_core.errors import RobotError
from ltvn_core.graph.deltas import EdgeAdded, EdgePruned, NodeAdded
from ltvn_core.importing.played_drive import open_robot
from ltvn_core.navigation.events import Event, GraphChanged, Outcome, QueryEnded, StampedEvent, Tick
from ltvn_core.recording.recorded_robot import RecordedRobot
from ltvn_core.recording.writer import RecordingWriter
from ltvn_core.robots.continued_robot import ContinuedRobot
from ltvn_core.robots.open_loop import require_drivable
from ltvn_core.robots.rectified_robot import fit_camera
from ltvn_core.robots.robot import Robot
from ltvn_core.topological_map import TopologicalMap
from ltvn_core.types import CONTROL_STEP_S, NodeId
from ltvn_core.verbs.headless_runner import QueriesSummary

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


@dataclass(frozen=True)
class QueryResult:
    """One query and what it changed in the map."""

    ended: QueryEnded
    pruned: int
    """Edges that left the map."""
    added: int
    """Edges and nodes that came in."""


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
        ended: QueryEnded | None = None
        changes: Counter[type[Any]] = Counter()
        try:
            with closing(self._navigator.query(goal, query)) as events:  # type: ignore[type-var]  # A generator.
                for event in events:
                    if isinstance(event, Tick):
                        self._robot.clock.advance(CONTROL_STEP_S)
                        continue
                    self._record(event)
                    if isinstance(event, GraphChanged):
                        self._draw()
                        changes[type(event.delta)] += 1
                    ended = event if isinstance(event, QueryEnded) else ended
        except RobotError as error:
            path = self._writer.path
            raise RobotError(f"{error} The query to node {goal} is over; {path} has what came before.") from error
        assert ended is not None
        _LOG.info("Node %d: %s after %.1f m.", goal, ended.outcome, ended.path_m)
        self._draw()
        return QueryResult(ended, changes[EdgePruned], changes[EdgeAdded] + changes[NodeAdded])

    def _draw(self) -> None:
        state = self._robot.state()
        self._writer.draw_graph(self._graph, state.step, state.stamp)

    def _record(self, event: Event) -> None:
        state = self._robot.state()
        self._writer.write_event(StampedEvent(state.step, state.stamp, event))


def summed_up(results: Sequence[QueryResult]) -> QueriesSummary:
    """Return what queries came to; reached is what the robot itself believes, for nobody knows better."""
    failures = Counter(str(each.ended.outcome) for each in results if each.ended.outcome is not Outcome.ARRIVED)
    return QueriesSummary(
        queries=len(results),
        reached=len(results) - failures.total(),
        collisions=sum(each.ended.collisions for each in results),
        pruned=sum(each.pruned for each in results),
        added=sum(each.added for each in results),
        failures=dict(failures),
    )
