"""People walk by ways of their own, are solid, and never walk into the robot."""

from collections.abc import Iterator

import numpy as np
import pytest

from ltvn_core.evaluation.encounters import EncounterLog
from ltvn_core.navigation.events import WorldChanged
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.simulation.body import PERSON_RADIUS_M
from ltvn_core.simulation.changes.people import WalkingPerson
from ltvn_core.simulation.changes.script_registry import make_script
from ltvn_core.simulation.changes.world import World
from ltvn_core.simulation.changes.world_script import HOUR_S
from ltvn_core.simulation.clearance_map import ClearanceMap
from ltvn_core.simulation.opening import open_simulation
from ltvn_core.simulation.scene import Scene
from ltvn_core.simulation.scene_registry import load_scene
from ltvn_core.simulation.simulated_robot import SimulatedRobot
from ltvn_core.types import CONTROL_STEP_S, ZERO_TWIST, Twist
from ltvn_core.worlds import PersonMoved

BEFORE_M = 1.2


@pytest.fixture(scope="module")
def scene() -> Scene:
    return load_scene("demo")


@pytest.fixture
def robot(scene: Scene) -> Iterator[SimulatedRobot]:
    """A robot among people."""
    simulation = open_simulation("demo", seed=1, script=make_script("people", scene, seed=1))
    yield simulation.robot
    simulation.robot.close()


def the_world(robot: SimulatedRobot) -> World:
    assert robot.world is not None
    return robot.world


def test_people_walk_and_never_touch_a_robot_that_stands(robot: SimulatedRobot, scene: Scene) -> None:
    world, log, ways = the_world(robot), EncounterLog(), []
    for _ in range(600):
        robot.advance(CONTROL_STEP_S)
        log.take(robot.stamp, robot.exact_pose, ZERO_TWIST, world.state.people, scene.clearance)
        ways.append([person.pose[:2] for person in world.state.people])
    walked_m = np.abs(np.diff(ways, axis=0)).sum(axis=(0, 2))
    assert (walked_m > 3).all()
    assert (scene.clearance.at(np.array(ways)) > PERSON_RADIUS_M - 0.06).all()
    assert robot.collisions == 0
    assert all(encounter.closest_m > 0.25 for encounter in log.finish())


def test_who_walks_is_told_twice_a_second_and_found_in_the_state(robot: SimulatedRobot) -> None:
    world, told = the_world(robot), list[WorldChanged]()
    world.follow(told.extend)
    robot.advance(20.0)
    moves = [event for event in told if isinstance(event.change, PersonMoved)]
    assert 20 < len(moves) <= 41 * 3
    assert all(event.outline is not None for event in moves)


def test_people_come_in_the_morning_and_are_gone_at_night(scene: Scene) -> None:
    world = World(scene, make_script("people", scene, seed=2), start_s=6 * HOUR_S)
    assert world.state.people == ()
    world.skip(3 * HOUR_S)
    assert len(world.state.people) == 3
    world.skip(14 * HOUR_S)
    assert world.state.people == ()


def test_a_person_is_solid_seen_and_not_pushed(robot: SimulatedRobot, scene: Scene) -> None:
    world, log = the_world(robot), EncounterLog()
    world.skip(14 * HOUR_S)
    places = scene.clearance.sample_poses(np.random.default_rng(3), 500, min_clearance_m=0.6)
    ends = places[:, :2] + BEFORE_M * np.stack([np.cos(places[:, 2]), np.sin(places[:, 2])], axis=-1)
    place = int(np.flatnonzero(scene.clearance.along(places[:, :2], ends) > 0.5)[0])
    robot.teleport(places[place])
    person = PersonMoved("Ada", (float(ends[place, 0]), float(ends[place, 1]), 0.0), seed=4)
    robot.apply(person)
    depth = robot.observe().depth
    assert depth is not None
    middle = depth[:36, 40:56]
    assert BEFORE_M - PERSON_RADIUS_M < middle[middle > 0].min() < BEFORE_M
    for _ in range(40):
        robot.drive(Twist(0.5, 0.0))
        robot.advance(CONTROL_STEP_S)
        log.take(robot.stamp, robot.exact_pose, robot.speeds, world.state.people, scene.clearance)
    assert robot.collisions == 1
    assert world.state.people == (person,)
    gap_m = np.linalg.norm(robot.exact_pose[:2] - person.pose[:2])
    assert gap_m == pytest.approx(LOCOBOT.radius_m + PERSON_RADIUS_M, abs=0.01)
    (encounter,) = log.finish()
    assert encounter.touched
    assert encounter.avoidable, "the robot drove ahead, and saw the person"


def test_a_person_steps_aside_for_a_robot_that_comes_nearer() -> None:
    place = np.array([0.0, 0.0, 0.0])
    floor = ClearanceMap(np.pad(np.zeros((80, 80), bool), 1, constant_values=True), np.array([-2.05, -2.05]))
    person = WalkingPerson("Ada", 1, place, np.random.default_rng(0))
    nearest_m = np.inf
    for step in range(60):
        robot = np.array([-1.5 + 0.04 * step, 0.02, LOCOBOT.radius_m])
        person.walk(CONTROL_STEP_S, floor, np.empty((0, 3)), robot)
        nearest_m = min(nearest_m, np.hypot(*(person.pose - robot)[:2]) - LOCOBOT.radius_m - PERSON_RADIUS_M)
        if robot[0] > 0.3:
            break
    assert nearest_m > 0.1
    assert not np.allclose(person.pose[:2], place[:2])


def test_nobody_stands_where_the_robot_is_put(robot: SimulatedRobot) -> None:
    world = the_world(robot)
    robot.advance(1.0)
    for person in world.state.people:
        robot.teleport(np.array(person.pose))
        robot.advance(CONTROL_STEP_S)
        assert robot.collisions == 0
