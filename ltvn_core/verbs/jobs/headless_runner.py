"""The loop without a browser: pulls the navigator, lets simulated time pass, and writes down everything.

Owns the order of driving, recording and judging. The page has its own loop (`ltvn_viz.session.session_loop`), because
there time is real and a person may interfere.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from ltvn_core.composition import Simulation
from ltvn_core.errors import MapError
from ltvn_core.graph.deltas import BULK_CAUSES, GraphDelta
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.navigation_system import NavigationSystem
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.navigation.episode import judge_goal_reached
from ltvn_core.navigation.events import Event, GraphChanged, Judged, StampedEvent, WorldChanged
from ltvn_core.navigation.lifelong_run import LifelongRun, random_goals
from ltvn_core.navigation.navigator import Navigator
from ltvn_core.recording.recorded_robot import RecordedRobot, record_images
from ltvn_core.recording.writer import RecordingWriter
from ltvn_core.simulation.scripted_tour import LED_M_S, TourSettings, drive_along, drive_tour
from ltvn_core.types import CONTROL_STEP_S, NodeId, Observation, Pose, Predictor


@dataclass(frozen=True)
class QueriesSummary:
    """What a number of queries came to."""

    queries: int
    reached: int
    """Queries that ended within 0.72 m and 0.4 rad of the goal by the robot's own decision."""
    collisions: int
    """Touches during the queries."""
    pruned: int
    """Edges that maintenance took away."""
    added: int
    """Edges and nodes that maintenance brought in."""
    failures: dict[str, int]
    """How the other queries ended, in the robot's own words; "arrived" means that it was wrong about that."""


class HeadlessRunner:
    """Robot, map and recording of one headless run."""

    def __init__(
        self,
        simulation: Simulation,
        writer: RecordingWriter,
        keyframes: KeyframeStore,
        predictor: Predictor,
        system: NavigationSystem,
        graph: TopologicalGraph,
    ) -> None:
        """Take hold of everything; an empty graph waits for `build`."""
        self.robot, self.scene, self.world = simulation.robot, simulation.scene, simulation.world
        self.writer, self.keyframes, self.graph = writer, keyframes, graph
        self.predictor = predictor
        self.system = system
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

            self._change(self.system.build(observations, self.keyframes, self.predictor, rng=rng, progress=show))

    def lead(self, path: NDArray[np.float64], consume: Callable[[Event], None]) -> None:
        """Drive along a path (M, 2) as a person would; what the map learns from it is recorded and handed on.

        Raises MapError where the navigation system only builds whole maps.
        """
        if self.system.online is None:
            raise MapError(f"A map of {self.system.name} does not grow while driving; build it anew.")
        online = self.system.online(self.graph, self.keyframes, self.predictor)
        images = drive_along(self.robot, self.world.scene, path, TourSettings(speed_m_s=LED_M_S))
        for observation in record_images(images, self.writer):
            for delta in online.offer(observation):
                self.graph.apply(delta)
                self.record(GraphChanged(delta))
                consume(GraphChanged(delta))
        self._draw()

    def run_queries(
        self,
        goals: Sequence[NodeId],
        rng: np.random.Generator,
        *,
        starts: Sequence[NodeId] | None = None,
    ) -> QueriesSummary:
        """Drive to each goal in turn, from where the last query ended or from `starts`, and judge by exact poses."""
        navigator = self.navigator(rng)
        lifelong = LifelongRun(self.record)
        before = None if starts is None else lambda query: self.robot.teleport(self._exact_pose(starts[query]))
        episodes = lifelong.run(
            navigator, goals, first_query=0, advance=self.advance, verdict=self.verdict, before=before
        )
        failures: Counter[str] = Counter()
        for episode in tqdm(episodes, desc="navigate", total=len(goals), unit="query"):
            self._draw()
            if not episode.reached:
                failures[episode.ended.outcome] += 1
        totals = lifelong.totals()
        return QueriesSummary(
            queries=totals.queries,
            reached=totals.reached,
            collisions=totals.collisions,
            pruned=totals.pruned,
            added=totals.added + totals.nodes_added,
            failures=dict(failures),
        )

    def navigator(self, rng: np.random.Generator) -> Navigator:
        """Return what drives by the map and maintains it."""
        return Navigator(
            RecordedRobot(self.robot, self.writer),
            self.graph,
            self.keyframes,
            self.predictor,
            self.system.method,
            rng,
            system=self.system,
            world_time=lambda: self.world.time_s,
        )

    def random_goals(self, count: int, rng: np.random.Generator) -> Sequence[NodeId]:
        """Draw nodes to go to; raises MapError on an empty map."""
        return random_goals(list(self.graph.nodes), count, rng)

    def map_observations(self) -> list[Observation]:
        """Return the images that belong to the map: those of its nodes, of its reserve and of views."""
        return [self.keyframes.observation(frame) for frame in self.graph.frames]

    def advance(self) -> None:
        """Let a control step pass."""
        self.robot.advance(CONTROL_STEP_S)

    def verdict(self, query: int, goal: NodeId) -> Judged:
        """Judge where the robot is by exact poses; raises MapError where the goal has none."""
        return judge_goal_reached(query, self.robot.exact_pose, self._exact_pose(goal))

    def _exact_pose(self, node: NodeId) -> Pose:
        pose = self.keyframes.observation(node).exact_pose
        if pose is None:
            raise MapError(f"Node {node} was not recorded in simulation, so arriving there cannot be judged.")
        return pose

    def record(self, event: Event) -> None:
        """Write down that something happened now."""
        state = self.robot.state()
        self.writer.write_event(StampedEvent(state.step, state.stamp, event))
        if isinstance(event, GraphChanged) and event.delta.cause not in BULK_CAUSES:
            self._draw()

    def _record_world(self, events: Sequence[WorldChanged]) -> None:
        for event in events:
            self.record(event)

    def _change(self, deltas: Sequence[GraphDelta]) -> None:
        for delta in deltas:
            self.graph.apply(delta)
            self.record(GraphChanged(delta))
        self._draw()

    def _draw(self) -> None:
        state = self.robot.state()
        self.writer.draw_graph(self.graph, state.step, state.stamp)
