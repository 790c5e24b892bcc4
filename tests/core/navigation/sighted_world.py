"""A flat world with depth images and two doors, one of which may be closed while the robot is about. Holds no test."""

from dataclasses import replace
from functools import cache

import numpy as np

from ltvn_core.config import ROBUST, Method
from ltvn_core.graph.builder import build
from ltvn_core.graph.deltas import GraphDelta
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.ltvn import ltvn_system
from ltvn_core.graph.navigation_system import NavigationSystem
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.navigation.navigator import Navigator
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.systems.maintenance import with_maintenance
from ltvn_core.types import Depth, Observation, Pose
from tests.core.flat_world import FlatPredictor, FlatRobot, FlatWorld, box, tour
from tests.core.navigation.mapped_world import FIRST_STEP, MappedWorld

NEAR_DOOR = [[3.0, 0.5], [3.0, 1.5]]
FAR_DOOR = [[3.0, 2.8], [3.0, 3.8]]
ROUND_TOUR = [
    (0.8, 1.0),
    (2.2, 1.0),
    (3.8, 1.0),
    (5.2, 1.0),
    (5.2, 3.3),
    (3.8, 3.3),
    (2.2, 3.3),
    (0.8, 3.3),
    (0.8, 1.0),
]


def two_doors() -> FlatWorld:
    """Return two rooms of 3 m x 4 m with two doors of 1 m between them."""
    wall = [[[3.0, 0.0], NEAR_DOOR[0]], [NEAR_DOOR[1], FAR_DOOR[0]], [FAR_DOOR[1], [3.0, 4.0]]]
    return FlatWorld(np.array([*box(6.0, 4.0), *wall]))


def with_things(world: FlatWorld, *walls: list[list[float]]) -> FlatWorld:
    """Return a world with more walls: closed doors, sides of boxes."""
    return FlatWorld(np.array([*world.walls.tolist(), *walls]))


def depth_at(world: FlatWorld, pose: Pose) -> Depth:
    """Return the depth image at a pose: the floor, and walls as high as the picture."""
    camera = LOCOBOT.camera
    columns = np.arange(camera.width)
    rays = camera.unproject(np.stack([columns, np.full_like(columns, camera.height // 2)], -1), np.ones(len(columns)))
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    ahead = np.stack([cos * rays[:, 0] - sin * rays[:, 1], sin * rays[:, 0] + cos * rays[:, 1]], axis=-1)
    start, along = world.walls[:, 0] - pose[:2], world.walls[:, 1] - world.walls[:, 0]
    cross = ahead[:, :1] * along[:, 1] - ahead[:, 1:] * along[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = (start[:, 0] * along[:, 1] - start[:, 1] * along[:, 0]) / cross
        share = (start[:, 0] * ahead[:, 1:] - start[:, 1] * ahead[:, :1]) / cross
    hit = (depth > 0.05) & (share >= 0) & (share <= 1)
    nearest = np.where(hit, depth, np.inf).min(axis=1)
    rows = np.arange(camera.height)
    middle = np.stack([np.full_like(rows, camera.width // 2), rows], -1)
    down = camera.height_m - camera.unproject(middle, np.ones(len(rows)))[:, 2]
    floor = np.where(down > 0, camera.height_m / np.maximum(down, 1e-6), np.inf)
    seen = np.minimum(nearest, floor[:, None])
    return np.where(np.isfinite(seen), seen, 0.0).astype(np.float32)


class SightedRobot(FlatRobot):
    """Sees the walls of its world as they are now, but for those of glass."""

    glass: tuple[list[list[float]], ...] = ()
    glass_breaks_at: float = np.inf

    def advance(self) -> None:
        """Let one control step pass; the glass may break."""
        super().advance()
        if self.glass and self.step >= self.glass_breaks_at:
            self.world, self.glass = self._shown(), ()

    def observe(self) -> Observation:
        """Take a blank picture with depth."""
        return replace(super().observe(), depth=depth_at(self._shown(), self.pose))

    def _shown(self) -> FlatWorld:
        return FlatWorld(self.world.walls[: len(self.world.walls) - len(self.glass)])


class DoorWorld(MappedWorld):
    """Two rooms with two doors, a map of both, and a robot whose system keeps presence."""

    system: NavigationSystem
    sighted: SightedRobot
    """The robot."""

    def navigator(self) -> Navigator:
        return Navigator(
            self.robot,
            self.graph,
            self.keyframes,
            self.predictor,
            self.system,
            np.random.default_rng(0),
        )

    def change(self, *walls: list[list[float]]) -> None:
        """Let the world be as it was, and with these walls; the predictor sees no farther than they let it."""
        self.robot.world = self.predictor.world = with_things(self.world, *walls)

    def put_glass(self, *walls: list[list[float]], breaks_after_steps: float = np.inf) -> None:
        """Put up walls that stop the robot and that no image shows."""
        self.sighted.world, self.sighted.glass = with_things(self.world, *walls), walls
        self.sighted.glass_breaks_at = self.sighted.step + breaks_after_steps

    def put(self, x: float, y: float, yaw: float = 0.0) -> None:
        """Put the robot somewhere else, where it stands still."""
        self.robot.pose = np.array([x, y, yaw])

    def wait(self, seconds: float) -> None:
        """Let time pass."""
        self.robot.step += round(seconds * 10)


@cache
def _mapping_drive() -> tuple[Observation, ...]:
    world = two_doors()
    return tuple(replace(seen, depth=depth_at(world, seen.odometry)) for seen in tour(ROUND_TOUR))


@cache
def _map(method: Method) -> tuple[GraphDelta, ...]:
    images, predictor = _mapping_drive(), FlatPredictor(two_doors())
    return build(images, KeyframeStore(predictor), predictor, method, np.random.default_rng(0))


def door_world(maintenance: str = "persistent", *, method: Method = ROBUST, drift: float = 0.0) -> DoorWorld:
    """Return the world with both doors open."""
    world, images = two_doors(), _mapping_drive()
    predictor = FlatPredictor(world)
    keyframes = KeyframeStore(predictor)
    keyframes.add(images)
    graph = TopologicalGraph(_map(method))
    poses = {seen.step: seen.exact_pose for seen in images if seen.exact_pose is not None}
    robot = SightedRobot(world, [0.8, 1.0, 0.0], first_step=FIRST_STEP, drift=drift)
    place = DoorWorld(world, robot, graph, keyframes, predictor, method, poses)
    place.sighted = robot
    place.system = with_maintenance(ltvn_system(method), maintenance)
    return place
