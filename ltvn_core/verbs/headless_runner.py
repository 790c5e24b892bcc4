"""The control loop without a browser: runs the navigator, advances simulated time, and records everything.

Owns the order of driving, recording and judging. The page has another loop (`ltvn_viz.session.session_loop`), because
there time is real and a user may interfere.
"""

import logging
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from ltvn_core.data.recording.recorded_run import RecordedRobot, record_images
from ltvn_core.data.recording.writer import RecordingWriter
from ltvn_core.errors import MapError, SceneError
from ltvn_core.evaluation.query_result import QueryResult
from ltvn_core.evaluation.query_run import judge_goal_reached, random_goals, run_queries
from ltvn_core.maps.topological_map import TopologicalMap
from ltvn_core.navigation.action_performer import ActionState
from ltvn_core.navigation.events import Event, GraphChanged, Judged, WorldChanged
from ltvn_core.navigation.navigator import Navigator
from ltvn_core.simulation.opening import Simulation
from ltvn_core.simulation.scripted_tour import LED_M_S, TourSettings, drive_along, drive_tour
from ltvn_core.types import CONTROL_STEP_S, NodeId, Observation, Pose
from ltvn_core.verbs.robot_queries import DrawnRun, QueriesSummary

_LOG = logging.getLogger(__name__)


class HeadlessRunner:
    """Robot, map and recording of one headless run."""

    def __init__(self, simulation: Simulation, writer: RecordingWriter, known: TopologicalMap) -> None:
        """Combine the parts of a run; an empty map waits for `build`."""
        self.robot = simulation.robot
        self.scene = simulation.scene
        self.world = simulation.world
        self.writer = writer
        self.map = known
        self._drawn = DrawnRun(simulation.robot, writer, known.graph)
        self.record = self._drawn.record
        self._record_world(simulation.world.events())
        simulation.world.follow(self._record_world)

    def collect(self, rng: np.random.Generator, loops: int) -> list[Observation]:
        """Drive a mapping tour, record it, and return its keyframes."""
        images = record_images(drive_tour(self.robot, self.scene, rng, loops=loops), self.writer)
        return list(tqdm(images, desc="collect", unit="frame"))

    def build(self, observations: Sequence[Observation], rng: np.random.Generator) -> None:
        """Build the map as the navigation system does, with a progress bar."""
        with tqdm(total=len(observations), desc="build", unit="image") as bar:

            def show(done: int, total: int) -> None:
                bar.total = total
                bar.update(done - bar.n)

            built = self.map.build(observations, rng=rng, progress=show)
        for delta in built:
            self.record(GraphChanged(delta))
        self._drawn.draw()

    def lead(self, path: NDArray[np.float64], consume: Callable[[Event], None]) -> None:
        """Drive along a path (M, 2) as a person would; each change of the map is recorded and passed to `consume`.

        Raises MapError if the navigation system cannot extend a map while driving.
        """
        system = self.map.system
        if system.online is None:
            raise MapError(f"A map of {system.name} does not grow while driving; rebuild it.")
        online = system.online(self.map.graph, self.map.keyframes, self.map.predictor)
        images = drive_along(self.robot, self.world.scene, path, TourSettings(speed_m_s=LED_M_S))
        for observation in record_images(images, self.writer):
            for delta in online.offer(observation):
                self.map.graph.apply(delta)
                self.record(GraphChanged(delta))
                consume(GraphChanged(delta))
        self._drawn.draw()

    def run_queries(
        self,
        goals: Sequence[NodeId],
        rng: np.random.Generator,
        *,
        starts: Sequence[NodeId] | None = None,
    ) -> QueriesSummary:
        """Drive to each goal in turn, from the end of the last query or from `starts`, and judge arrival by exact
        poses."""
        before = None if starts is None else lambda query: self.robot.teleport(self._exact_pose(starts[query]))
        queries = run_queries(
            self.navigator(rng), goals, advance=self.advance, verdict=self.verdict, before=before, consume=self.record
        )
        results: list[QueryResult] = []
        for result in tqdm(queries, desc="navigate", total=len(goals), unit="query"):
            self._drawn.draw()
            results.append(result)
        return QueriesSummary.of(results)

    def navigator(self, rng: np.random.Generator) -> Navigator:
        """Return a navigator that drives by the map and maintains it."""
        robot = RecordedRobot(self.robot, self.writer)
        actions = SimulatedActions(lambda node: self.robot.teleport(self._exact_pose(node)))
        return self.map.navigator(robot, seed=rng, world_time=lambda: self.world.time_s, actions=actions)

    def random_goals(self, count: int, rng: np.random.Generator) -> Sequence[NodeId]:
        """Draw random nodes as goals; raises MapError for an empty map."""
        return random_goals(list(self.map.graph.nodes), count, rng)

    def advance(self) -> None:
        """Advance the simulation by one control step."""
        self.robot.advance(CONTROL_STEP_S)

    def verdict(self, query: int, goal: NodeId) -> Judged:
        """Judge by exact poses whether the robot is at the goal; raises MapError if the goal has no exact pose."""
        return judge_goal_reached(query, self.robot.exact_pose, self._exact_pose(goal))

    def _exact_pose(self, node: NodeId) -> Pose:
        pose = self.map.keyframes.observation(node).exact_pose
        if pose is None:
            raise MapError(f"Node {node} was not recorded in simulation, so arriving there cannot be judged.")
        return pose

    def _record_world(self, events: Sequence[WorldChanged]) -> None:
        for event in events:
            self.record(event)


class SimulatedActions:
    """Puts a simulated robot at the target at once, because no simulated lift carries it there."""

    def __init__(self, put_at: Callable[[NodeId], None]) -> None:
        """`put_at` puts the robot at a node; raises MapError or SceneError where that is impossible."""
        self._put_at = put_at
        self._state = ActionState.FAILED

    def begin(self, source: NodeId, target: NodeId, action: str) -> None:
        """Put the robot at `target`; if it cannot stand there, the action fails."""
        try:
            self._put_at(target)
        except (MapError, SceneError) as error:
            _LOG.warning("%s: the simulated robot cannot stand at node %d: %s", action, target, error)
            self._state = ActionState.FAILED
        else:
            self._state = ActionState.DONE

    def state(self) -> ActionState:
        """Return the state of the action that was begun last."""
        return self._state
