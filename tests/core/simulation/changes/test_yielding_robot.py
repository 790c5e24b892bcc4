"""The robot tells what moves from what stands: it waits for people, and for nothing in a world that stands still."""

from collections.abc import Iterator

import numpy as np
import pytest

from ltvn_core.navigation.bystanders import Bystanders
from ltvn_core.navigation.obstacle_memory import ObstacleMemory
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.simulation.opening import open_simulation
from ltvn_core.simulation.simulated_robot import SimulatedRobot
from ltvn_core.types import CONTROL_STEP_S, Pose, Twist
from ltvn_core.worlds import PersonMoved

LOOK_EVERY = 3


@pytest.fixture
def robot() -> Iterator[SimulatedRobot]:
    """A robot with some free floor before it."""
    simulation = open_simulation("demo", seed=0)
    clearance = simulation.scene.clearance
    places = clearance.sample_poses(np.random.default_rng(3), 500, min_clearance_m=0.6)
    ends = places[:, :2] + 1.8 * np.stack([np.cos(places[:, 2]), np.sin(places[:, 2])], axis=-1)
    simulation.robot.teleport(places[int(clearance.along(places[:, :2], ends).argmax())])
    yield simulation.robot
    simulation.robot.close()


def watching() -> ObstacleMemory:
    return ObstacleMemory(LOCOBOT, bystanders=Bystanders())


def person_before(pose: Pose, ahead_m: float, left_m: float) -> PersonMoved:
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    x, y = pose[0] + cos * ahead_m - sin * left_m, pose[1] + sin * ahead_m + cos * left_m
    return PersonMoved("Ada", (float(x), float(y), 0.0), seed=4)


def look(robot: SimulatedRobot, memory: ObstacleMemory, times: int = 1) -> list[bool]:
    """Let some time pass before each look; return whether something moved ahead each time."""
    moved: list[bool] = []
    for _ in range(times):
        robot.advance(LOOK_EVERY * CONTROL_STEP_S)
        memory.add(robot.observe())
        moved.append(memory.moves_ahead(robot.state().odometry))
    return moved


def test_who_walks_across_moves_and_who_has_stopped_does_not(robot: SimulatedRobot) -> None:
    memory, pose = watching(), robot.exact_pose
    assert look(robot, memory, 4) == [False] * 4
    for left_m in (0.6, 0.35, 0.1):
        robot.apply(person_before(pose, 0.9, left_m))
        moved = look(robot, memory)
    assert moved == [True]
    assert memory.bystanders.are_about(robot.stamp)
    assert look(robot, memory, 3)[-1] is False, "who stands is an obstacle like others"
    assert len(memory.nearby_points(robot.state().odometry)) > 20


def test_who_walks_far_away_is_noticed_and_not_waited_for(robot: SimulatedRobot) -> None:
    memory, pose = watching(), robot.exact_pose
    assert look(robot, memory, 4) == [False] * 4
    assert not memory.bystanders.are_about(robot.stamp)
    robot.apply(person_before(pose, 1.7, 0.1))
    assert look(robot, memory) == [False]
    assert memory.bystanders.are_about(robot.stamp)


def test_the_robot_keeps_more_distance_from_what_moves(robot: SimulatedRobot) -> None:
    pose, nearest_m = robot.exact_pose, list[float]()
    for watches in (False, True):
        memory = watching() if watches else ObstacleMemory(LOCOBOT)
        look(robot, memory, 4)
        robot.apply(person_before(pose, 1.0, 0.0))
        look(robot, memory)
        points = memory.nearby_points(robot.state().odometry)
        ahead = points[(np.abs(points[:, 1]) < 0.2) & (points[:, 0] > 0)]
        nearest_m.append(float(ahead[:, 0].min()))
        robot.apply(person_before(pose, 1.0, 4.0))
    assert nearest_m[1] == pytest.approx(nearest_m[0] - 0.15, abs=0.03)


def test_nothing_moves_while_the_robot_drives_about_in_a_world_that_stands_still(robot: SimulatedRobot) -> None:
    memory, moved = watching(), list[bool]()
    rng = np.random.default_rng(0)
    for _ in range(40):
        twist = Twist(float(rng.uniform(0, 0.5)), float(rng.uniform(-1, 1)))
        for _ in range(3):
            robot.drive(twist)
            robot.advance(CONTROL_STEP_S)
        memory.add(robot.observe())
        moved.append(memory.moves_ahead(robot.state().odometry) or memory.bystanders.are_about(robot.stamp))
    assert not any(moved)


def test_a_memory_that_does_not_watch_movement_knows_none(robot: SimulatedRobot) -> None:
    memory = ObstacleMemory(LOCOBOT)
    look(robot, memory, 3)
    robot.apply(person_before(robot.exact_pose, 0.9, 0.0))
    assert look(robot, memory) == [False]
