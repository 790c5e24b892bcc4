"""A scene with a map, in which queries are driven and judged by the simulator's truth.

Owns one scene, one map and one network. Each query gets a robot and dice of its own, so that an episode goes the same
way whoever runs it, in whatever order, and can be run again for its recording.
"""

from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import numpy as np

from ltvn_core.evaluate.causes import EpisodeWitness
from ltvn_core.evaluate.ground import Ground
from ltvn_core.evaluate.protocol import EpisodePlan, Protocol
from ltvn_core.evaluate.results import EpisodeResult, Failure
from ltvn_core.evaluate.truth import MapTruth, shortest_m
from ltvn_core.graph.system import System
from ltvn_core.graph.views import Views
from ltvn_core.nav.episode import Episode, judge, run_episode
from ltvn_core.nav.events import Event, Outcome
from ltvn_core.nav.navigator import Navigator
from ltvn_core.recording.maps import check_fingerprint, load_map
from ltvn_core.sim.camera import open_camera
from ltvn_core.sim.odometry import OdometryNoise
from ltvn_core.sim.robot import SimulatedRobot
from ltvn_core.sim.scene import Scene
from ltvn_core.types import CONTROL_STEP_S, FrameId, Predictor, Robot

Watch = Callable[[Event, SimulatedRobot], None]
"""Hears of an event while the robot still stands where it happened."""


def _as_it_is(robot: SimulatedRobot) -> Robot:
    return robot


class Course:
    """Runs queries with one map."""

    def __init__(self, scene: Scene, map_file: Path, predictor: Predictor, system: System, protocol: Protocol) -> None:
        """Load a map. Raises MapError where other weights made it."""
        loaded = load_map(map_file)
        check_fingerprint(loaded.meta, predictor.fingerprint)
        self.scene, self.graph, self.views = scene, loaded.graph, Views(predictor)
        self.views.add(list(loaded.observations.values()))
        self.truth = MapTruth(scene.clearance, self.views.observation)
        self.fingerprint = predictor.fingerprint
        self._camera, self.predictor, self.system = open_camera(scene), predictor, system
        self.noise = OdometryNoise(protocol.distance_noise, protocol.angle_noise)
        self._next_frame = max(self.views.frames) + 1

    @property
    def ground(self) -> Ground:
        """Where single edges between the images of the map can be driven."""
        poses = {frame: self.truth.pose(frame) for frame in self.views.frames}
        return Ground(self.scene, self._camera, self.views, poses)

    def run(
        self,
        query: int,
        plan: EpisodePlan,
        rng: np.random.Generator,
        *,
        watch: Watch | None = None,
        through: Callable[[SimulatedRobot], Robot] = _as_it_is,
        first_frame: FrameId | None = None,
    ) -> EpisodeResult:
        """Drive one query and judge it; `through` may put something between the navigator and the robot.

        Images are numbered from `first_frame`; where nobody says, after those that were taken before.
        """
        if plan.goal not in self.graph.nodes:
            return self._without_goal(query, plan)
        witness = EpisodeWitness(self.truth, self.graph)
        with closing(self._robot(plan, rng, self._next_frame if first_frame is None else first_frame)) as robot:
            parts = self.graph, self.views, self.predictor, self.system.method, rng
            navigator = Navigator(through(robot), *parts, system=self.system)

            def hear(event: Event) -> None:
                witness.consume(event, robot.exact_pose)
                if watch is not None:
                    watch(event, robot)

            episode = run_episode(
                navigator,
                plan.goal,
                query,
                advance=lambda: robot.advance(CONTROL_STEP_S),
                verdict=lambda: judge(query, robot.exact_pose, np.array(plan.goal_pose)),
                consume=hear,
            )
            self._next_frame = max(self._next_frame, robot.step + 1)
        return self._result(plan, episode, witness)

    def _robot(self, plan: EpisodePlan, rng: np.random.Generator, first_frame: FrameId) -> SimulatedRobot:
        return SimulatedRobot(
            self.scene,
            self._camera,
            start=np.array(plan.start_pose),
            rng=rng,
            odometry_noise=self.noise,
            first_step=first_frame,
        )

    def _result(self, plan: EpisodePlan, episode: Episode, witness: EpisodeWitness) -> EpisodeResult:
        ended, judged = episode.ended, episode.judged
        # The criterion asks for the robot's own decision: standing there by chance when time runs out does not count.
        reached = judged.reached and ended.outcome is Outcome.ARRIVED
        return EpisodeResult(
            ended.query,
            plan.start,
            plan.goal,
            reached,
            ended.outcome.value,
            None if reached else witness.failure(ended, judged),
            None if reached else witness.sightings.trigger,
            ended.steps,
            ended.collisions,
            ended.path_m,
            self._shortest(plan),
            judged.position_error_m,
            judged.yaw_error_rad,
        )

    def _without_goal(self, query: int, plan: EpisodePlan) -> EpisodeResult:
        judged = judge(query, np.array(plan.start_pose), np.array(plan.goal_pose))
        gap = judged.position_error_m, judged.yaw_error_rad
        why = Outcome.NO_PATH.value, Failure.NO_PATH, Failure.NO_PATH
        return EpisodeResult(query, plan.start, plan.goal, False, *why, 0, 0, 0.0, self._shortest(plan), *gap)

    def _shortest(self, plan: EpisodePlan) -> float:
        return shortest_m(self.scene.clearance, np.array(plan.start_pose), np.array(plan.goal_pose))
