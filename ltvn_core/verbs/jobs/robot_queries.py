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

from ltvn_core.composition import open_robot
from ltvn_core.errors import RobotError
from ltvn_core.graph.deltas import EdgeAdded, EdgePruned, NodeAdded
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.navigation_system import NavigationSystem
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.navigation.events import Event, GraphChanged, Outcome, QueryEnded, StampedEvent, Tick
from ltvn_core.navigation.navigator import Navigator
from ltvn_core.recording.recorded_robot import RecordedRobot
from ltvn_core.recording.writer import RecordingWriter
from ltvn_core.robots.open_loop import require_drivable
from ltvn_core.robots.robot import Robot
from ltvn_core.types import CONTROL_STEP_S, NodeId, Predictor
from ltvn_core.verbs.jobs.headless_runner import QueriesSummary

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
