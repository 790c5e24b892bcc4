"""Runs episodes with one map in one scene, and evaluates them with the ground truth: success, causes, checkpoints.

Each query has its own robot and random generator, so that an episode is the same in every process and order, and can be
repeated for its recording.
"""

from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ltvn_core.evaluation.failure_causes import FailureClassifier
from ltvn_core.evaluation.ground_truth import GroundTruth, shortest_m
from ltvn_core.evaluation.perturbations import PerturbedRobot
from ltvn_core.evaluation.plans import RunFiles, open_planned_system
from ltvn_core.evaluation.protocol import EpisodePlan, EvaluationProtocol, light_under
from ltvn_core.evaluation.query_result import FailureCause, QueryResult
from ltvn_core.evaluation.query_run import judge_goal_reached, run_query
from ltvn_core.geometry import lengths_along, points_along
from ltvn_core.maps.topological_map import TopologicalMap
from ltvn_core.navigation.bystanders import Bystanders
from ltvn_core.navigation.events import Event, Outcome
from ltvn_core.predictors.opening import open_predictor
from ltvn_core.robots.robot import Robot
from ltvn_core.simulation.body_names import BodyName
from ltvn_core.simulation.changes.world import World
from ltvn_core.simulation.clearance_map import ClearanceMap
from ltvn_core.simulation.rendering.renderer_opening import open_renderer
from ltvn_core.simulation.scene import Scene
from ltvn_core.simulation.scene_registry import load_scene
from ltvn_core.simulation.simulated_robot import SimulatedRobot
from ltvn_core.simulation.surfaces import PLAIN_LIGHT, Light
from ltvn_core.types import CONTROL_STEP_S, FrameId, Pose

SPACING_M = 1.0
"""Distance between two checkpoints, in metres (ours)."""
CROSSED_M = 0.72
"""Distance within which the robot crosses a checkpoint, in metres: the paper's distance for reaching a goal."""


class Checkpoints:
    """Checkpoints along the path to a goal. The share that the robot crossed measures the progress of a failed episode.

    The measure of VISTA (arXiv 2606.17294). Reads the ground truth; the robot does not use the checkpoints.
    """

    def __init__(self, clearance: ClearanceMap, start: Pose, goal: Pose) -> None:
        """Place checkpoints on the path through the middle of free space, the last at the goal; none without a path."""
        way = clearance.path(start[:2], goal[:2])
        self._xy = np.empty((0, 2)) if way is None else _each_metre(way)
        self._crossed = np.zeros(len(self._xy), bool)

    def see(self, robot: Pose) -> None:
        """Mark the checkpoints around the exact pose (3,) of the robot as crossed."""
        self._crossed |= np.hypot(*(self._xy - robot[:2]).T) < CROSSED_M

    @property
    def count(self) -> int:
        """Number of checkpoints."""
        return len(self._xy)

    @property
    def crossed(self) -> int:
        """Number of checkpoints crossed so far, in any order."""
        return int(self._crossed.sum())


def _each_metre(way: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the checkpoints (N, 2) of a path (M, 2), without its start."""
    length_m = lengths_along(way)[-1]
    return points_along(way, np.append(np.arange(SPACING_M, length_m, SPACING_M), length_m))


EventCallback = Callable[[Event, SimulatedRobot], None]
"""Called with an event while the robot is still at the place of the event."""


StepCallback = Callable[[SimulatedRobot], None]
"""Called after each control step."""


class EpisodeRunner:
    """Runs queries with one map."""

    def __init__(
        self,
        scene: Scene,
        known: TopologicalMap,
        protocol: EvaluationProtocol,
        *,
        perturbations: Sequence[str] = (),
        light: Light = PLAIN_LIGHT,
        world: World | None = None,
    ) -> None:
        """Drive with a map; the robot's camera has these perturbations, and the scene has this light.

        `world` may change the scene, and has its own light.
        """
        self.scene = scene
        self.map = known
        self.truth = GroundTruth(scene.clearance, known.keyframes.observation)
        self.camera = open_renderer(scene if light == PLAIN_LIGHT else replace(scene, light=light))
        self.noise = protocol.odometry_noise
        self.body: BodyName = protocol.body
        self._perturbations = perturbations
        self._world = world
        self._bystanders = Bystanders()
        self._next_frame = max(known.keyframes.frames) + 1

    def run(
        self,
        query: int,
        plan: EpisodePlan,
        rng: np.random.Generator,
        *,
        on_event: EventCallback | None = None,
        wrap_robot: Callable[[Robot], Robot] | None = None,
        first_frame: FrameId | None = None,
        on_step: StepCallback | None = None,
    ) -> QueryResult:
        """Drive one query and evaluate it; `wrap_robot` may wrap the robot that the navigator gets.

        Images are numbered from `first_frame`, by default after all earlier ones. `on_step` sees the robot after each
        control step.
        """
        start, goal = np.array(plan.start_pose), np.array(plan.goal_pose)
        checkpoints = Checkpoints(self.scene.clearance, start, goal)
        shortest = shortest_m(self.scene.clearance, start, goal)
        if plan.goal not in self.map.graph.nodes:  # The robot does not start.
            judged = judge_goal_reached(query, start, goal)
            return QueryResult(
                query=query,
                start=plan.start,
                goal=plan.goal,
                reached=False,
                outcome=Outcome.NO_PATH.value,
                failure=FailureCause.NO_PATH,
                trigger=FailureCause.NO_PATH,
                shortest_m=shortest,
                position_error_m=judged.position_error_m,
                yaw_error_rad=judged.yaw_error_rad,
                checkpoints=checkpoints.count,
                crossed=0,
                localised=0,
                mislocalised=0,
            )
        classifier = FailureClassifier(self.truth, self.map.graph)
        world = self._world
        robot = SimulatedRobot(
            self.scene,
            self.camera,
            start=start,
            rng=rng,
            odometry_noise=self.noise,
            first_step=self._next_frame if first_frame is None else first_frame,
            world=world,
            body=self.body,
        )
        with closing(robot):
            looking = PerturbedRobot(robot, self._perturbations, seed=query) if self._perturbations else robot
            navigator = self.map.navigator(
                looking if wrap_robot is None else wrap_robot(looking),
                seed=rng,
                bystanders=self._bystanders,
                world_time=None if world is None else lambda: world.time_s,
            )

            def consume_event(event: Event) -> None:
                classifier.consume(event, robot.exact_pose)
                if on_event is not None:
                    on_event(event, robot)

            def advance() -> None:
                robot.advance(CONTROL_STEP_S)
                checkpoints.see(robot.exact_pose)
                if on_step is not None:
                    on_step(robot)

            result = run_query(
                navigator,
                plan.goal,
                query,
                advance=advance,
                verdict=lambda: judge_goal_reached(query, robot.exact_pose, goal),
                consume=consume_event,
            )
            self._next_frame = max(self._next_frame, robot.step + 1)
        cause = classifier.failure(result)
        # The criterion includes the robot's own decision: being at the goal by chance at the step limit does not count.
        reached = result.reached and result.outcome == Outcome.ARRIVED
        return replace(
            result,
            start=plan.start,
            reached=reached,
            failure=None if reached else cause,
            trigger=None if reached else classifier.trigger,
            shortest_m=shortest,
            checkpoints=checkpoints.count,
            crossed=checkpoints.crossed,
            localised=classifier.localised,
            mislocalised=classifier.mislocalised,
        )


def episode_rng(seed: int, episode: int) -> np.random.Generator:
    """Return the random generator of one episode."""
    return np.random.default_rng([seed, 3, episode])


def open_runner(files: RunFiles, queries: int = 0, *, maintain: bool = False) -> EpisodeRunner:
    """Load the map after a number of queries, with its scene and network."""
    plan = files.plan
    scene = load_scene(plan.scene)
    predictor = open_predictor(plan.predictor, plan.scene, files.weights, device=plan.device)
    system = open_planned_system(plan, predictor, scene, maintain=maintain)
    return EpisodeRunner(
        scene,
        TopologicalMap.load(files.map(queries), predictor, system=system),
        plan.protocol,
        perturbations=plan.perturbations,
        light=light_under(plan.conditions),
    )


@lru_cache(maxsize=1)
def cached_runner(files: RunFiles, queries: int) -> EpisodeRunner:
    """Return the runner of a frozen map, cached between batches; its map must not be changed."""
    return open_runner(files, queries)
