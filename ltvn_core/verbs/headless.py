"""The loop without a browser: pulls the navigator, lets simulated time pass, and writes down everything.

Owns the order of driving, recording and judging. The page has its own loop (`ltvn_viz.session`), because there time is
real and a person may interfere.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from tqdm import tqdm, trange

from ltvn_core.composition import Simulation
from ltvn_core.config import Method
from ltvn_core.errors import MapError
from ltvn_core.graph.builder import build
from ltvn_core.graph.deltas import EdgeAdded, EdgePruned, GraphDelta, NodeAdded
from ltvn_core.graph.topograph import TopologicalGraph
from ltvn_core.graph.views import Views
from ltvn_core.nav.episode import judge
from ltvn_core.nav.events import Event, GraphChanged, QueryEnded, Stamped, Tick
from ltvn_core.nav.navigator import Navigator
from ltvn_core.recording.writer import RecordingWriter
from ltvn_core.sim.robot import CONTROL_STEP_S, SimulatedRobot
from ltvn_core.sim.tour import tour
from ltvn_core.types import NodeId, Observation, Predictor, RobotState, Twist


class RecordedRobot:
    """A robot whose every look is written down. Implements `ltvn_core.types.Robot`."""

    def __init__(self, robot: SimulatedRobot, writer: RecordingWriter) -> None:
        self._robot = robot
        self._writer = writer
        self.drive: Callable[[Twist], None] = robot.drive
        self.stop: Callable[[], None] = robot.stop
        self.state: Callable[[], RobotState] = robot.state

    def observe(self) -> Observation:
        """Take a picture and record it."""
        seen = self._robot.observe()
        self._writer.frame(seen)
        return seen


@dataclass
class Tally:
    """What a number of queries came to."""

    reached: int = 0
    collisions: int = 0
    pruned: int = 0
    added: int = 0
    failures: Counter[str] = field(default_factory=Counter)
    """By the outcome that the robot gave; a wrong "arrived" is among them."""

    def summary(self) -> dict[str, Any]:
        """Return the counts by name."""
        return asdict(self) | {"failures": dict(self.failures)}

    def count(self, event: Event) -> None:
        """Take note of an event that counts."""
        match event:
            case GraphChanged(delta=EdgePruned()):
                self.pruned += 1
            case GraphChanged(delta=NodeAdded() | EdgeAdded()):
                self.added += 1
            case QueryEnded(collisions=collisions):
                self.collisions += collisions


class Workbench:
    """Robot, map and recording of one headless run."""

    def __init__(
        self,
        simulation: Simulation,
        writer: RecordingWriter,
        views: Views,
        predictor: Predictor,
        method: Method,
        graph: TopologicalGraph | None = None,
    ) -> None:
        """Take hold of everything; without a `graph` the map is empty until `build`."""
        self.simulation, self.writer, self.views = simulation, writer, views
        self.predictor, self.method = predictor, method
        self.graph = graph or TopologicalGraph()

    def record(self, event: Event) -> None:
        """Write an event down at the robot's present moment."""
        state = self.simulation.robot.state()
        self.writer.event(Stamped(state.step, state.stamp, event))

    def change(self, deltas: Sequence[GraphDelta]) -> None:
        """Apply deltas to the map and write them down."""
        for delta in deltas:
            self.graph.apply(delta)
            self.record(GraphChanged(delta))
        self.draw()

    def draw(self) -> None:
        """Write a picture of the whole map for the viewer."""
        state = self.simulation.robot.state()
        self.writer.graph(self.graph, state.step, state.stamp)

    def collect(self, rng: np.random.Generator, loops: int) -> list[Observation]:
        """Drive a mapping tour, record it, and return its keyframes."""
        seen = []
        robot, scene = self.simulation.robot, self.simulation.scene
        for observation in tqdm(tour(robot, scene, rng, loops=loops), desc="collect", unit="frame"):
            self.writer.frame(observation)
            seen.append(observation)
        return seen

    def build(self, observations: Sequence[Observation], rng: np.random.Generator) -> None:
        """Build the map by Algorithm 1, with a progress bar."""
        with tqdm(total=len(observations), desc="build", unit="image") as bar:
            progress = lambda done, _total: bar.update(done - bar.n)  # noqa: E731
            self.change(build(observations, self.views, self.predictor, self.method, rng, progress=progress))

    def navigator(self, rng: np.random.Generator) -> Navigator:
        """Return a navigator that drives the robot by this map and records what it sees."""
        robot = RecordedRobot(self.simulation.robot, self.writer)
        return Navigator(robot, self.graph, self.views, self.predictor, self.method, rng)

    def run_queries(self, count: int, rng: np.random.Generator, tally: Tally) -> None:
        """Drive to `count` random nodes one after another, each from where the last one ended."""
        navigator = self.navigator(rng)
        for query in trange(count, desc="navigate", unit="query"):
            self.run_query(navigator, self.random_goal(rng), query, tally)

    def run_query(self, navigator: Navigator, goal: NodeId, query: int, tally: Tally) -> None:
        """Drive one query to its end and judge it by the paper's criterion from exact poses."""
        ended: QueryEnded | None = None
        for event in navigator.query(goal, query):
            if isinstance(event, Tick):
                self.simulation.robot.advance(CONTROL_STEP_S)
                continue
            self.record(event)
            tally.count(event)
            ended = event if isinstance(event, QueryEnded) else ended
        assert ended is not None, "a query always says how it ended"
        verdict = judge(ended, self.simulation.robot.exact_pose, self._exact_pose(goal))
        self.record(verdict)
        self.draw()
        tally.reached += verdict.reached
        if not verdict.reached:
            tally.failures[ended.outcome] += 1

    def random_goal(self, rng: np.random.Generator) -> NodeId:
        """Draw a node to go to; raises MapError on an empty map."""
        if not self.graph.nodes:
            raise MapError("The map has no nodes, so there is nowhere to go; record more images and build it again.")
        return int(rng.choice(list(self.graph.nodes)))

    def kept(self) -> list[Observation]:
        """Return the images that belong to the map: those of its nodes and of its reserve."""
        return [self.views.observation(frame) for frame in (*self.graph.nodes, *self.graph.reserve)]

    def _exact_pose(self, goal: NodeId) -> np.ndarray:
        pose = self.views.observation(goal).exact_pose
        if pose is None:
            raise MapError(f"Goal {goal} was not recorded in simulation, so arriving there cannot be judged.")
        return pose
