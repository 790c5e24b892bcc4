"""Runs episodes with one map in one scene, and evaluates them with the ground truth.

Each query gets a robot and a random generator of its own, so that an episode is the same in every process and order,
and can be repeated for its recording.
"""

from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np

from ltvn_core.evaluation.checkpoints import Checkpoints
from ltvn_core.evaluation.failure_causes import FailureClassifier
from ltvn_core.evaluation.ground_truth import GroundTruth, shortest_m
from ltvn_core.evaluation.imaged_scene import ImagedScene
from ltvn_core.evaluation.perturbations.perturbed_robot import PerturbedRobot
from ltvn_core.evaluation.protocol import EpisodePlan, EvaluationProtocol
from ltvn_core.evaluation.results import EpisodeResult, FailureCause
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.navigation_system import NavigationSystem
from ltvn_core.navigation.bystanders import Bystanders
from ltvn_core.navigation.episode import Episode, judge_goal_reached, run_episode
from ltvn_core.navigation.events import Event, Outcome
from ltvn_core.navigation.navigator import Navigator
from ltvn_core.recording.map_file import check_fingerprint, load_map
from ltvn_core.robots.robot import Robot
from ltvn_core.simulation.body_names import BodyName
from ltvn_core.simulation.changes.world import World
from ltvn_core.simulation.rendering.renderer_selection import open_renderer
from ltvn_core.simulation.scene import Scene
from ltvn_core.simulation.simulated_robot import SimulatedRobot
from ltvn_core.simulation.surfaces import PLAIN_LIGHT, Light
from ltvn_core.types import CONTROL_STEP_S, FrameId, Predictor

EventCallback = Callable[[Event, SimulatedRobot], None]
"""Called with an event while the robot is still where it happened."""


StepCallback = Callable[[SimulatedRobot], None]
"""Called after each control step."""


def _advance(robot: SimulatedRobot, checkpoints: Checkpoints, on_step: StepCallback | None) -> None:
    robot.advance(CONTROL_STEP_S)
    checkpoints.see(robot.exact_pose)
    if on_step is not None:
        on_step(robot)


def _unwrapped(robot: Robot) -> Robot:
    return robot


class EpisodeRunner:
    """Runs queries with one map."""

    def __init__(
        self,
        scene: Scene,
        map_file: Path,
        predictor: Predictor,
        system: NavigationSystem,
        protocol: EvaluationProtocol,
        *,
        perturbations: Sequence[str] = (),
        light: Light = PLAIN_LIGHT,
        world: World | None = None,
    ) -> None:
        """Load a map; the robot's camera will have these perturbations, and see the scene in this light.

        `world` may change around the robot, and has a light of its own.

        Raises MapError where other weights made the map.
        """
        loaded = load_map(map_file)
        check_fingerprint(loaded.meta, predictor.fingerprint)
        self.scene = scene
        self.graph = loaded.graph
        self.keyframes = KeyframeStore(predictor)
        self.keyframes.begin_drives(self.graph.drives)
        self.keyframes.add(list(loaded.observations.values()))
        self.truth = GroundTruth(scene.clearance, self.keyframes.observation)
        self.fingerprint = predictor.fingerprint
        self._camera = open_renderer(scene if light == PLAIN_LIGHT else replace(scene, light=light))
        self.predictor = predictor
        self.system = system
        self.noise = protocol.odometry_noise
        self.body: BodyName = protocol.body
        self._perturbations = perturbations
        self._world, self._bystanders = world, Bystanders()
        self._next_frame = max(self.keyframes.frames) + 1

    @property
    def imaged_scene(self) -> ImagedScene:
        """The scene with the images of the map, for driving single edges."""
        poses = {frame: self.truth.pose(frame) for frame in self.keyframes.frames}
        return ImagedScene(scene=self.scene, camera=self._camera, keyframes=self.keyframes, poses=poses)

    def run(
        self,
        query: int,
        plan: EpisodePlan,
        rng: np.random.Generator,
        *,
        on_event: EventCallback | None = None,
        wrap_robot: Callable[[Robot], Robot] = _unwrapped,
        first_frame: FrameId | None = None,
        on_step: StepCallback | None = None,
    ) -> EpisodeResult:
        """Drive one query and evaluate it; `wrap_robot` may wrap the robot that the navigator gets.

        Images are numbered from `first_frame`, by default after all earlier ones. `on_step` sees the robot after each
        control step.
        """
        if plan.goal not in self.graph.nodes:
            return self._without_goal(query, plan)
        classifier = FailureClassifier(self.truth, self.graph)
        with closing(self._robot(plan, rng, self._next_frame if first_frame is None else first_frame)) as robot:
            parts = self.graph, self.keyframes, self.predictor, self.system.method, rng
            looking = wrap_robot(self._looking(robot, query))
            navigator = Navigator(
                looking, *parts, system=self.system, bystanders=self._bystanders, world_time=self._world_time
            )

            checkpoints = self._checkpoints(plan)

            def consume_event(event: Event) -> None:
                classifier.consume(event, robot.exact_pose)
                if on_event is not None:
                    on_event(event, robot)

            episode = run_episode(
                navigator,
                plan.goal,
                query,
                advance=lambda: _advance(robot, checkpoints, on_step),
                verdict=lambda: judge_goal_reached(query, robot.exact_pose, np.array(plan.goal_pose)),
                consume=consume_event,
            )
            self._next_frame = max(self._next_frame, robot.step + 1)
        return self._result(plan, episode, classifier, checkpoints)

    def _robot(self, plan: EpisodePlan, rng: np.random.Generator, first_frame: FrameId) -> SimulatedRobot:
        return SimulatedRobot(
            self.scene,
            self._camera,
            start=np.array(plan.start_pose),
            rng=rng,
            odometry_noise=self.noise,
            first_step=first_frame,
            world=self._world,
            body=self.body,
        )

    @property
    def _world_time(self) -> Callable[[], float] | None:
        world = self._world
        return None if world is None else lambda: world.time_s

    def _looking(self, robot: SimulatedRobot, query: int) -> Robot:
        """Return the robot as its camera shows the world."""
        return PerturbedRobot(robot, self._perturbations, seed=query) if self._perturbations else robot

    def _checkpoints(self, plan: EpisodePlan) -> Checkpoints:
        return Checkpoints(self.scene.clearance, np.array(plan.start_pose), np.array(plan.goal_pose))

    def _result(
        self, plan: EpisodePlan, episode: Episode, classifier: FailureClassifier, checkpoints: Checkpoints
    ) -> EpisodeResult:
        ended, judged = episode.ended, episode.judged
        cause = classifier.failure(ended, judged)
        counts = classifier.statistics
        # The criterion asks for the robot's own decision: standing there by chance when time runs out does not count.
        reached = judged.reached and ended.outcome is Outcome.ARRIVED
        return EpisodeResult(
            episode=ended.query,
            start=plan.start,
            goal=plan.goal,
            reached=reached,
            outcome=ended.outcome.value,
            failure=None if reached else cause,
            trigger=None if reached else counts.trigger,
            steps=ended.steps,
            collisions=ended.collisions,
            path_m=ended.path_m,
            shortest_m=self._shortest(plan),
            position_error_m=judged.position_error_m,
            yaw_error_rad=judged.yaw_error_rad,
            checkpoints=checkpoints.count,
            crossed=checkpoints.crossed,
            localised=counts.localised,
            mislocalised=counts.mislocalised,
        )

    def _without_goal(self, query: int, plan: EpisodePlan) -> EpisodeResult:
        """Return the result of an episode whose goal is no node of the map; the robot does not start."""
        judged = judge_goal_reached(query, np.array(plan.start_pose), np.array(plan.goal_pose))
        return EpisodeResult(
            episode=query,
            start=plan.start,
            goal=plan.goal,
            reached=False,
            outcome=Outcome.NO_PATH.value,
            failure=FailureCause.NO_PATH,
            trigger=FailureCause.NO_PATH,
            steps=0,
            collisions=0,
            path_m=0.0,
            shortest_m=self._shortest(plan),
            position_error_m=judged.position_error_m,
            yaw_error_rad=judged.yaw_error_rad,
            checkpoints=self._checkpoints(plan).count,
            crossed=0,
            localised=0,
            mislocalised=0,
        )

    def _shortest(self, plan: EpisodePlan) -> float:
        return shortest_m(self.scene.clearance, np.array(plan.start_pose), np.array(plan.goal_pose))
