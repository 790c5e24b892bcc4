"""A closed door is in the way of body, camera and path alike, and a world whose changes are undone is the old one."""

import pickle
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest

from ltvn_core.errors import WorldError
from ltvn_core.navigation.events import ChangedBy, WorldChanged
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.simulation.changes.world import World
from ltvn_core.simulation.changes.world_script import MORNING_S, TimedChange, WorldScript
from ltvn_core.simulation.clearance_map import ClearanceMap
from ltvn_core.simulation.rendering.embree_renderer import EmbreeRenderer
from ltvn_core.simulation.rooms import Doorway
from ltvn_core.simulation.scene import Scene
from ltvn_core.simulation.scene_registry import load_scene
from ltvn_core.simulation.simulated_robot import SimulatedRobot
from ltvn_core.simulation.wheel_odometry import OdometryNoise
from ltvn_core.types import CONTROL_STEP_S, Observation, Pose, Twist
from ltvn_core.worlds import (
    AS_MADE,
    DoorMoved,
    LightChanged,
    PicturesExchanged,
    ThingKind,
    ThingPlaced,
    ThingRemoved,
    ThingReturned,
    WorldChange,
)

DOOR = 0
BEFORE_M = 1.0
"""The robot stands so far from the wall's middle, facing the door,"""
LEAF_M = 0.95
"""and so far from its leaf."""
NEAR_M = 0.4
"""Nothing stands so near to a doorway."""
SOFA = "own/sofa-0"

Enter = Callable[[World], SimulatedRobot]


@pytest.fixture(scope="module")
def scene() -> Scene:
    return load_scene("demo")


@pytest.fixture(scope="module")
def renderer(scene: Scene) -> EmbreeRenderer:
    return EmbreeRenderer(scene.surfaces)


@pytest.fixture
def world(scene: Scene) -> World:
    return World(scene)


@pytest.fixture
def enter(scene: Scene, renderer: EmbreeRenderer) -> Iterator[Enter]:
    """Put a robot before the door of a world."""
    robots: list[SimulatedRobot] = []

    def _enter(world: World) -> SimulatedRobot:
        rng = np.random.default_rng(0)
        start = beside(scene.parts.doors[DOOR], -BEFORE_M)
        noise = OdometryNoise.NONE
        robots.append(SimulatedRobot(scene, renderer, start=start, rng=rng, odometry_noise=noise, world=world))
        return robots[-1]

    yield _enter
    for robot in robots:
        robot.close()


def beside(door: Doorway, away_m: float) -> Pose:
    """Return a pose on one side of a door, looking across the wall towards larger coordinates."""
    x, y = door.middle
    return np.array([x + away_m, y, 0.0]) if door.axis == 0 else np.array([x, y + away_m, np.pi / 2])


def way_m(clearance: ClearanceMap, door: Doorway) -> float:
    """Return the length of the way from one side of a door to the other."""
    return float(clearance.path_lengths(beside(door, -NEAR_M), beside(door, NEAR_M)[:2])[0])


def _cell(clearance: ClearanceMap, pose: Pose) -> tuple[int, int]:
    column, row = np.floor((pose[:2] - clearance.origin) / clearance.resolution_m).astype(int)
    return int(row), int(column)


def ahead(robot: SimulatedRobot) -> float:
    """Return what the camera's middle sees, in metres."""
    depth = robot.observe().depth
    assert depth is not None
    return float(depth[depth.shape[0] // 2, depth.shape[1] // 2])


def forward(robot: SimulatedRobot, seconds: float) -> None:
    for _ in range(round(seconds / CONTROL_STEP_S)):
        robot.drive(Twist(0.5, 0.0))
        robot.advance(CONTROL_STEP_S)


def box_at(pose: Pose, name: str = "parcel") -> ThingPlaced:
    return ThingPlaced(name, ThingKind.BOX, (float(pose[0]), float(pose[1]), 0.3), (0.4, 0.3, 0.5))


def _kept(image: Observation) -> Observation:
    return image


def _changed(image: Observation) -> Observation:
    return replace(image, stamp=image.stamp + 1)


def _sent(image: Observation) -> Observation:
    """Return what another process gets."""
    return pickle.loads(pickle.dumps(image))


def test_a_closed_door_stops_the_robot_and_an_open_one_lets_it_pass(world: World, enter: Enter) -> None:
    robot = enter(world)
    robot.apply(DoorMoved(DOOR, is_open=False))
    forward(robot, 4.0)
    assert robot.collisions == 1
    before_leaf = np.linalg.norm(robot.exact_pose[:2] - world.base.parts.doors[DOOR].middle)
    assert before_leaf == pytest.approx(0.05 + LOCOBOT.radius_m, abs=0.01)

    robot.teleport(beside(world.base.parts.doors[DOOR], -BEFORE_M))
    robot.apply(DoorMoved(DOOR, is_open=True))
    forward(robot, 4.0)
    assert robot.collisions == 1
    assert np.linalg.norm(robot.exact_pose[:2] - beside(world.base.parts.doors[DOOR], -BEFORE_M)[:2]) > 1.3


def test_the_camera_sees_the_leaf_where_it_is_at_once(world: World, enter: Enter) -> None:
    robot = enter(world)
    far, picture = ahead(robot), robot.observe()
    robot.apply(DoorMoved(DOOR, is_open=False))
    assert ahead(robot) == pytest.approx(LEAF_M, abs=0.005) != pytest.approx(far, abs=0.5)
    assert robot.observe().rgb.std() > 5, "a leaf has a texture"
    assert robot.observe().step > picture.step, "two pictures never have one name"
    robot.apply(DoorMoved(DOOR, is_open=True))
    assert np.array_equal(robot.observe().rgb, picture.rgb)
    assert ahead(robot) == far


@pytest.mark.parametrize("use", [_kept, _changed, _sent])
def test_an_image_shows_the_world_as_it_was_whenever_its_colours_are_asked_for(
    world: World, enter: Enter, use: Callable[[Observation], Observation]
) -> None:
    robot = enter(world)
    rgb, depth = robot.render(LOCOBOT.camera)
    image = robot.observe()
    robot.apply(DoorMoved(DOOR, is_open=False))
    forward(robot, 0.3)
    assert not np.array_equal(robot.observe().rgb, rgb)
    assert np.array_equal(use(image).rgb, rgb)
    assert np.array_equal(use(image).require_depth("a test"), depth)


@pytest.mark.parametrize("door", range(8))
def test_the_way_through_a_closed_door_is_gone_or_leads_round(world: World, scene: Scene, door: int) -> None:
    doorway = scene.parts.doors[door]
    assert way_m(scene.clearance, doorway) == pytest.approx(2 * NEAR_M)
    world.apply(DoorMoved(door, is_open=False))
    assert way_m(world.scene.clearance, doorway) > 3.0
    for side in (-NEAR_M, NEAR_M):
        pieces = world.scene.clearance.navigable
        assert pieces[_cell(world.scene.clearance, beside(doorway, side))], "who is shut in still gets about"


@pytest.mark.parametrize("seed", range(5))
def test_undoing_brings_back_exactly_what_was_there(scene: Scene, seed: int) -> None:
    world, rng = World(scene), np.random.default_rng(seed)
    doors = np.array([door.middle for door in scene.parts.doors])
    places = scene.clearance.sample_poses(rng, 99, min_clearance_m=0.5)
    away_m = np.linalg.norm(places[:, None, :2] - doors, axis=-1).min(axis=1)
    places = places[away_m > 1.2]
    box, sofa = places[np.argsort(places[:, 0])[[0, -1]]].tolist()
    possible: tuple[WorldChange, ...] = (
        DoorMoved(1, is_open=False),
        DoorMoved(4, is_open=False),
        ThingPlaced("parcel", ThingKind.BOX, tuple(box), (0.4, 0.3, 0.5)),
        ThingPlaced(SOFA, ThingKind.FURNITURE, tuple(sofa), (1.0, 1.0, 1.0)),
        ThingRemoved("own/bed-0"),
        LightChanged(0.4, 0.5),
        PicturesExchanged(3),
    )
    chosen = [possible[number] for number in rng.permutation(len(possible))]
    for change in chosen[:3]:
        world.apply(change)
    before, scene_before = world.state, world.scene
    for change in chosen[3:]:
        world.apply(change)
    world.undo_to(before)
    assert world.state == before
    assert np.array_equal(world.scene.clearance.blocked, scene_before.clearance.blocked)
    world.undo_to(AS_MADE)
    assert world.scene is scene


def test_the_world_knows_which_goals_can_be_reached_now(world: World, scene: Scene) -> None:
    here, beyond = (beside(scene.parts.doors[DOOR], side) for side in (-NEAR_M, NEAR_M))
    goals = np.array([here + np.array((0.1, 0.1, 0.0)), beyond])
    assert world.reachable(here, goals).tolist() == [True, True]
    for door in range(len(scene.parts.doors)):
        world.apply(DoorMoved(door, is_open=False))
    assert world.reachable(here, goals).tolist() == [True, False]


def test_a_box_is_seen_bumped_into_and_gone_round(world: World, scene: Scene, enter: Enter) -> None:
    robot, place = enter(world), beside(scene.parts.doors[DOOR], -0.4)
    robot.apply(box_at(place))
    assert scene.clearance.at(place[:2]) > 0.3
    assert world.scene.clearance.at(place[:2]) == 0
    forward(robot, 3.0)
    assert robot.collisions == 1
    robot.apply(ThingRemoved("parcel"))
    forward(robot, 3.0)
    assert robot.collisions == 1


def test_furniture_that_is_taken_away_leaves_free_floor_and_comes_back(world: World, scene: Scene) -> None:
    piece = next(piece for piece in scene.parts.furniture if piece.name == "sofa-0")
    world.apply(ThingRemoved(SOFA))
    assert scene.clearance.at((piece.x, piece.y)) == 0
    assert world.scene.clearance.at((piece.x, piece.y)) > 0.2
    assert len(world.scene.surfaces.faces) == len(scene.surfaces.faces) - (piece.end_face - piece.first_face)
    world.apply(ThingReturned(SOFA))
    assert world.scene is scene


def test_furniture_blocks_as_much_floor_elsewhere(world: World, scene: Scene) -> None:
    piece = next(piece for piece in scene.parts.furniture if piece.name == "sofa-0")
    world.apply(ThingRemoved(SOFA))
    without = np.count_nonzero(world.scene.clearance.blocked)
    own_place = (piece.x, piece.y, piece.yaw_rad)
    world.apply(ThingPlaced(SOFA, ThingKind.FURNITURE, own_place, (piece.width, piece.depth, 1.0)))
    assert np.array_equal(world.scene.clearance.blocked, scene.clearance.blocked)
    assert np.count_nonzero(scene.clearance.blocked) > without


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (DoorMoved(99, is_open=False), "Doors have numbers from 0 to 7"),
        (ThingRemoved("nothing"), "nothing of that name"),
        (ThingRemoved("own/throne-0"), "no furniture"),
        (ThingPlaced("", ThingKind.BOX, (1.0, 1.0, 0.0), (0.4, 0.4, 0.4)), "1 to 64"),
        (ThingPlaced("wide", ThingKind.BOX, (1.0, 1.0, 0.0), (9.0, 0.4, 0.4)), "between 0.05 and 3"),
        (ThingPlaced("lost", ThingKind.BOX, (float("nan"), 1.0, 0.0), (0.4, 0.4, 0.4)), "x and y in metres"),
        (ThingPlaced("far", ThingKind.BOX, (999.0, 1.0, 0.0), (0.4, 0.4, 0.4)), "Choose a free place"),
        (ThingPlaced("own/box", ThingKind.BOX, (1.0, 1.0, 0.0), (0.4, 0.4, 0.4)), "without 'own/'"),
        (LightChanged(7.0), "brightness"),
    ],
)
def test_what_cannot_be_is_refused_and_changes_nothing(world: World, change: WorldChange, why: str) -> None:
    with pytest.raises(WorldError, match=why):
        world.apply(change)
    assert world.state == AS_MADE


def test_nothing_is_put_onto_the_robot(world: World, scene: Scene, enter: Enter) -> None:
    robot = enter(world)
    with pytest.raises(WorldError, match="the robot is there"):
        robot.apply(box_at(robot.exact_pose))
    robot.teleport(beside(scene.parts.doors[DOOR], 0.0))
    with pytest.raises(WorldError, match="Drive it away first"):
        robot.apply(DoorMoved(DOOR, is_open=False))


def test_a_script_waits_until_the_robot_has_left_the_doorway(scene: Scene, enter: Enter) -> None:
    closing = TimedChange(MORNING_S + 0.5, DoorMoved(DOOR, is_open=False))
    world = World(scene, WorldScript("test", changes=(closing,)))
    robot = enter(world)
    robot.teleport(beside(scene.parts.doors[DOOR], 0.0))
    robot.advance(1.0)
    assert world.state == AS_MADE
    robot.teleport(beside(scene.parts.doors[DOOR], BEFORE_M))
    robot.advance(0.2)
    assert world.state.closed_doors == {DOOR}


def test_time_can_pass_without_physics_and_brings_what_the_script_says(scene: Scene, enter: Enter) -> None:
    hours = [TimedChange(MORNING_S + 3600.0 * hour, DoorMoved(hour, is_open=False)) for hour in (1, 2, 3)]
    world = World(scene, WorldScript("test", changes=tuple(hours)))
    robot, told = enter(world), list[WorldChanged]()
    world.follow(told.extend)
    world.skip(2.5 * 3600)
    assert robot.stamp == 0.0
    assert world.time_s == MORNING_S + 2.5 * 3600
    assert world.state.closed_doors == {1, 2}
    assert [(event.at_s, event.by) for event in told[1:]] == [(each.at_s, ChangedBy.SCRIPT) for each in hours[:2]]


def test_another_robot_finds_the_world_as_the_last_one_left_it(scene: Scene, enter: Enter) -> None:
    world = World(scene)
    first = enter(world)
    first.advance(2.0)
    first.apply(DoorMoved(DOOR, is_open=False))
    first.close()
    second = enter(world)
    assert ahead(second) == pytest.approx(LEAF_M, abs=0.005)
    second.advance(1.0)
    assert world.time_s == pytest.approx(MORNING_S + 3.0)
