"""Queries with a robot outside the simulator: time is real, and everything is recorded.

Guarantees that the robot is stopped and closed at the end. Simulated runs are recorded and summarised in the same way.
"""

import logging
import sys
import threading
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from ltvn_core.data.importing.played_drive import open_robot
from ltvn_core.data.recording.recorded_run import RecordedRobot
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.errors import OptionError, RobotError
from ltvn_core.evaluation.query_result import QueryResult
from ltvn_core.evaluation.query_run import run_query
from ltvn_core.graph.deltas import BULK_CAUSES
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.maps.topological_map import TopologicalMap
from ltvn_core.navigation.action_performer import ActionState
from ltvn_core.navigation.events import Event, GraphChanged, StampedEvent
from ltvn_core.robots.robot import Robot, open_loop_word
from ltvn_core.robots.robot_view import ContinuedRobot, fit_camera
from ltvn_core.types import CONTROL_STEP_S, NodeId

_LOG = logging.getLogger(__name__)


@contextmanager
def opened_robot(name: str, *, drives: bool = True) -> Iterator[Robot]:
    """Open a robot, and stop and close it at the end, even after an error.

    Raises PluginError, DriveError, RobotError, and OptionError if `drives` is set but the robot accepts no commands.
    """
    robot = open_robot(name)
    try:
        if drives and (word := open_loop_word(robot)):
            raise OptionError(word)
        yield robot
    finally:
        robot.stop()
        getattr(robot, "close", lambda: None)()


def continued_robot(own: Robot, known: TopologicalMap) -> ContinuedRobot:
    """Return a robot with the camera of a map's images; its steps and stamps continue those of the map."""
    last = known.keyframes.observation(known.keyframes.frames[-1])
    return ContinuedRobot(fit_camera(own, known.predictor.camera), last_step=last.step, last_stamp_s=last.stamp)


class DrawnRun:
    """Records the events of a robot that drives by a map, and the drawing of the map when it changes."""

    def __init__(self, robot: Robot, writer: RecordingWriter, graph: TopologicalGraph) -> None:
        """Use the robot's clock for the stamps."""
        self._robot = robot
        self._writer = writer
        self._graph = graph

    def record(self, event: Event) -> None:
        """Record an event with the current time of the robot."""
        state = self._robot.state()
        self._writer.write_event(StampedEvent(state.step, state.stamp, event))
        if isinstance(event, GraphChanged) and event.delta.cause not in BULK_CAUSES:
            self.draw()

    def draw(self) -> None:
        """Record a drawing of the current map."""
        state = self._robot.state()
        self._writer.draw_graph(self._graph, state.step, state.stamp)


@dataclass(frozen=True)
class QueriesSummary:
    """Results of several queries."""

    queries: int
    reached: int
    """Queries that ended within 0.72 m and 0.4 rad of the goal by the robot's own decision."""
    collisions: int
    """Number of collisions during the queries."""
    pruned: int
    """Number of edges that maintenance pruned."""
    added: int
    """Number of edges and nodes that maintenance added."""
    failures: dict[str, int]
    """Number of other queries by their outcome, as the robot reported it; "arrived" is an arrival at the wrong
    place."""

    @classmethod
    def of(cls, results: Sequence[QueryResult]) -> "QueriesSummary":
        """Summarise the results of queries."""
        return cls(
            queries=len(results),
            reached=sum(each.reached for each in results),
            collisions=sum(each.collisions for each in results),
            pruned=sum(each.pruned for each in results),
            added=sum(each.added_edges + each.added_nodes for each in results),
            failures=dict(Counter(each.outcome for each in results if not each.reached)),
        )


class RobotQueries:
    """Drives a robot to nodes of a map, one query after the other."""

    def __init__(
        self,
        robot: Robot,
        writer: RecordingWriter,
        known: TopologicalMap,
        rng: np.random.Generator,
    ) -> None:
        """Drive by a map and maintain it as its system does; images and events go to `writer`."""
        self._clock = robot.clock
        self._path = writer.path
        self._drawn = DrawnRun(robot, writer, known.graph)
        actions = TerminalActions() if sys.stdin.isatty() else None
        self._navigator = known.navigator(RecordedRobot(robot, writer), seed=rng, actions=actions)

    def drive_to(self, goal: NodeId, query: int) -> QueryResult:
        """Run a query in real time and record it. Raises RobotError if the robot is lost; it has been stopped then."""
        try:
            result = run_query(
                self._navigator,
                goal,
                query,
                advance=lambda: self._clock.advance(CONTROL_STEP_S),
                consume=self._drawn.record,
            )
        except RobotError as error:
            raise RobotError(f"{error} The query to node {goal} is over; {self._path} has what came before.") from error
        _LOG.info("Node %d: %s after %.1f m.", goal, result.outcome, result.path_m)
        self._drawn.draw()
        return result


class TerminalActions:
    """Asks the person at the terminal to perform the action, and waits for the answer in a thread."""

    def __init__(self, ask: Callable[[str], str] = input) -> None:
        """`ask` prints a question and returns the answer; raises EOFError if nobody can answer."""
        self._ask = ask
        self._state = ActionState.FAILED
        self._thread: threading.Thread | None = None

    def begin(self, source: NodeId, target: NodeId, action: str) -> None:
        """Ask for an action; a question without an answer from an earlier action stands for this one."""
        self._state = ActionState.PENDING
        if self._thread is not None and self._thread.is_alive():
            _LOG.info("Now: %s (node %d to node %d).", action, source, target)
            return
        question = (
            f"{action} (node {source} to node {target}). Press Enter when it is done, or n and Enter if it failed. "
        )
        self._thread = threading.Thread(target=self._wait, args=(question,), name="action answer", daemon=True)
        self._thread.start()

    def state(self) -> ActionState:
        """Return the state of the action that was begun last."""
        return self._state

    def _wait(self, question: str) -> None:
        try:
            has_failed = self._ask(question).strip().lower().startswith("n")
        except EOFError:
            has_failed = True
        self._state = ActionState.FAILED if has_failed else ActionState.DONE
