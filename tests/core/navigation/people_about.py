"""A flat room with one person who walks, and a robot whose depth images show room, floor and person."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.config import ROBUST
from ltvn_core.geometry import compose, rotation
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.matching import Matcher
from ltvn_core.navigation.attempt_driver import AttemptDriver, AttemptResult
from ltvn_core.navigation.bystanders import Bystanders
from ltvn_core.navigation.perception import MotionExecutor, Perception
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.simulation.body import PERSON_RADIUS_M
from ltvn_core.types import CONTROL_STEP_S, Depth, Observation, Pose, Twist
from tests.core.flat_world import FlatPredictor, FlatRobot, FlatWorld, observation_at

Walk = Callable[[float], tuple[float, float]]
"""Where the person would be after so many seconds."""

_STOPS_M = 0.3
"""A person never walks nearer to the robot."""


def depth_of(
    walls: NDArray[np.float64], person: NDArray[np.float64], pose: Pose, camera: CameraModel = LOCOBOT.camera
) -> Depth:
    """Return what the robot's camera at `pose` (3,) shows of walls (W, 2, 2) and of a person (2,)."""
    right: NDArray[np.float64] = (np.arange(camera.width, dtype=np.float64) - camera.cx) / camera.fx
    rays = np.stack([np.ones_like(right), -right], axis=-1)
    rays = (rays @ rotation(float(pose[2])).T).astype(np.float64)
    nearest = np.minimum(_to_walls(walls, pose[:2], rays), _to_person(person - pose[:2], rays))
    down = (np.arange(camera.height) - camera.cy) / camera.fy
    floor = np.where(down > 0, camera.height_m / np.maximum(down, 1e-6), np.inf)
    return np.minimum(nearest, floor[:, None]).astype(np.float32)


def _to_walls(
    walls: NDArray[np.float64], origin: NDArray[np.float64], rays: NDArray[np.float64]
) -> NDArray[np.float64]:
    start, along = walls[:, 0] - origin, walls[:, 1] - walls[:, 0]
    det = rays[:, :1] * along[:, 1] - rays[:, 1:] * along[:, 0]
    det = np.where(np.abs(det) < 1e-9, np.nan, det)
    away = (start[:, 0] * along[:, 1] - start[:, 1] * along[:, 0]) / det
    share = (start[:, 0] * rays[:, 1:] - start[:, 1] * rays[:, :1]) / det
    hit = (away > 0) & (share >= 0) & (share <= 1)
    return np.where(hit, away, np.inf).min(axis=1)


def _to_person(gap: NDArray[np.float64], rays: NDArray[np.float64]) -> NDArray[np.float64]:
    square, along = (rays**2).sum(axis=1), rays @ gap
    root = along**2 - square * (gap @ gap - PERSON_RADIUS_M**2)
    away = (along - np.sqrt(np.maximum(root, 0.0))) / square
    return np.where((root > 0) & (away > 0), away, np.inf)


class RobotAmongPeople(FlatRobot):
    """A robot in a room with one person, who stops before touching it."""

    def __init__(self, world: FlatWorld, pose: list[float], walk: Walk) -> None:
        super().__init__(world, pose, first_step=100)
        self._walk, self._from_s = walk, self.state().stamp
        self.person = np.array(walk(0.0))
        self.nearest_m = self.gap_m

    @property
    def gap_m(self) -> float:
        """Metres between the two bodies."""
        return float(np.hypot(*(self.person - self.pose[:2]))) - LOCOBOT.radius_m - PERSON_RADIUS_M

    def observe(self) -> Observation:
        seen = super().observe()
        return replace(seen, depth=depth_of(self.world.walls, self.person, self.pose))

    def advance(self) -> None:
        super().advance()
        before, gap_m = self.person, self.gap_m
        self.person = np.array(self._walk(self.step * CONTROL_STEP_S - self._from_s))
        if self.gap_m < min(_STOPS_M, gap_m):
            self.person = before
        self.nearest_m = min(self.nearest_m, self.gap_m)


class Attempts:
    """A robot among people, which makes attempts to reach places."""

    def __init__(self, world: FlatWorld, start: list[float], walk: Walk) -> None:
        self._world = world
        self.robot = RobotAmongPeople(world, start, walk)
        self.bystanders = Bystanders()
        self.commands: list[Twist] = []

    def go(self, ahead_m: float) -> AttemptResult:
        """Make an attempt to reach a place so far ahead of the robot; let time pass until it ends."""
        waypoint = np.array([ahead_m, 0.0, 0.0])
        predictor = FlatPredictor(self._world, sight_m=4.0)
        keyframes = KeyframeStore(predictor)
        keyframes.add([observation_at(compose(self.robot.pose, waypoint), 0)])
        motion = MotionExecutor(self.robot, 0, ROBUST.recovering)
        perception = Perception(motion, predictor, Matcher(predictor, keyframes, ROBUST.matching))
        driver = AttemptDriver(motion, perception, ROBUST.driving, LOCOBOT, bystanders=self.bystanders)
        self.commands = []
        ends: list[AttemptResult] = []

        def drive() -> Iterator[object]:
            ends.append((yield from driver.drive(0, waypoint, around={})))

        for _ in drive():
            self.robot.advance()
            self.commands.append(self.robot.twist)
        return ends[0]
