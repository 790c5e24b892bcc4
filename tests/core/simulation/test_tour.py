"""A mapping tour visits every room like a careful driver and ends."""

from contextlib import closing
from dataclasses import dataclass

import numpy as np
import pytest

from ltvn_core.geometry import relative
from ltvn_core.simulation.scene_registry import Scene, load_scene
from ltvn_core.simulation.scripted_tour import TourSettings, drive_tour
from ltvn_core.simulation.simulated_robot import SimulatedRobot
from ltvn_core.types import ZERO_TWIST, Observation
from tests.core.simulation.fake_scene import GreyCamera


@dataclass(frozen=True)
class Tour:
    """What came of one."""

    observations: list[Observation]
    collisions: int
    robot_stands: bool


@pytest.fixture(scope="module")
def scene() -> Scene:
    return load_scene("train-00")


@pytest.fixture(scope="module")
def toured(scene: Scene) -> Tour:
    return _toured(scene, 1, loops=2)


def test_a_tour_visits_all_rooms_that_have_free_floor(scene: Scene, toured: Tour) -> None:
    seen = np.array([observation.exact_pose for observation in toured.observations])
    cells = np.argwhere(scene.clearance.navigable)[:, ::-1]
    places = scene.clearance.origin + (cells + 0.5) * scene.clearance.resolution_m
    rooms = [(room.x0, room.y0, room.x1, room.y1) for room in scene.rooms]
    free = [edges for edges in rooms if _inside(places, edges).sum() > 20]
    assert len(free) >= 3
    for edges in free:
        assert _inside(seen[:, :2], edges).any()


def test_a_tour_hardly_ever_hits_anything(toured: Tour) -> None:
    assert toured.collisions <= 2


def test_images_are_taken_a_little_way_apart(toured: Tour) -> None:
    odometry = np.array([observation.odometry for observation in toured.observations])
    dx, dy, dtheta = np.abs(relative(odometry[:-1], odometry[1:])).T
    style = TourSettings()
    assert ((np.hypot(dx, dy) >= style.image_every_m) | (dtheta >= style.image_every_rad)).all()
    assert np.hypot(dx, dy).max() < 0.25
    assert dtheta.max() < 0.4


def test_a_tour_shows_rooms_from_all_sides(toured: Tour) -> None:
    yaws = np.array([observation.odometry[2] for observation in toured.observations])
    in_sectors, _ = np.histogram(yaws, bins=8, range=(-np.pi, np.pi))
    assert in_sectors.min() >= 10


def test_a_tour_ends_and_the_robot_stands(toured: Tour) -> None:
    assert 100 < len(toured.observations) < 2000
    assert toured.robot_stands


def test_the_same_seed_drives_the_same_tour(scene: Scene) -> None:
    first, again, other = (_toured(scene, seed, loops=1) for seed in (3, 3, 4))
    places = [
        np.array([observation.exact_pose for observation in drive.observations]) for drive in (first, again, other)
    ]
    assert np.array_equal(places[0], places[1])
    assert not np.array_equal(places[0], places[2])


def _toured(scene: Scene, seed: int, *, loops: int) -> Tour:
    rng = np.random.default_rng(seed)
    start = scene.clearance.sample_poses(rng, 1, min_clearance_m=0.35)[0]
    with closing(SimulatedRobot(scene, GreyCamera(), start=start, rng=rng)) as robot:
        observations = list(drive_tour(robot, scene, rng, loops=loops))
        robot.advance(0.1)
        return Tour(observations, robot.collisions, robot.speeds == ZERO_TWIST)


def _inside(points: np.ndarray, edges: tuple[float, float, float, float]) -> np.ndarray:
    x0, y0, x1, y1 = edges
    return (points[:, 0] > x0) & (points[:, 0] < x1) & (points[:, 1] > y0) & (points[:, 1] < y1)
