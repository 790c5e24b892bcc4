"""Where nodes are joined that no image joins: by a turn on the spot, and over floor that was seen free."""

import itertools
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from ltvn_core.config import ROBUST
from ltvn_core.geometry import compose, relative
from ltvn_core.graph.deltas import Cause, EdgeAdded, GraphDelta, NodeAdded
from ltvn_core.graph.floor_edges import CourseErrors, floor_edges
from ltvn_core.graph.free_floor import FreeFloor
from ltvn_core.graph.matching import Matches
from ltvn_core.graph.odometry_gate import DriveLink, OdometryGate
from ltvn_core.graph.operators import bidirectional_edges, node_from_observation
from ltvn_core.graph.topological_graph import TopologicalGraph
from ltvn_core.robots.robot_spec import LOCOBOT, NeededSpace
from ltvn_core.simulation.opening import open_simulation
from ltvn_core.simulation.simulated_robot import SimulatedRobot
from ltvn_core.simulation.wheel_odometry import OdometryNoise
from ltvn_core.types import Depth, Observation
from tests.core.flat_world import observation_at, one_room
from tests.core.navigation.people_about import depth_of
from tests.core.simulation.two_room_mesh import box_house, save

AHEAD = np.array([0.6, 0.0, 0.0])


def there_and_back(aside_m: float = 0.2, count: int = 6) -> list[Observation]:
    """Return pictures of a way and of the way back beside it."""
    out = [np.array([0.6 * k, 0.0, 0.0]) for k in range(count)]
    back = [np.array([0.6 * k, aside_m, np.pi]) for k in reversed(range(count))]
    return [observation_at(pose, 10 * k) for k, pose in enumerate([*out, *back])]


def chain(images: list[Observation]) -> TopologicalGraph:
    """Return a map whose edges join the pictures in a row."""
    deltas: list[GraphDelta] = [NodeAdded(node_from_observation(images[0]), Cause.BUILD)]
    for last, seen in itertools.pairwise(images):
        waypoint = np.array([[-0.6, 0.0, 0.0]])
        matches = Matches((last.step,), np.array([0.9]), waypoint, np.array([0.6]), np.ones(1, bool))
        deltas.append(NodeAdded(node_from_observation(seen), Cause.BUILD))
        deltas += bidirectional_edges(seen.step, matches, ROBUST.believing, Cause.BUILD)
    return TopologicalGraph(deltas)


def turns(images: list[Observation], gate: OdometryGate | None = None) -> list[EdgeAdded]:
    gate = gate or OdometryGate(images, ROBUST.building)
    floor = FreeFloor([replace(seen, depth=None) for seen in images], LOCOBOT.camera, gate, LOCOBOT.needed_space)
    return list(floor_edges(chain(images), gate, floor, ROBUST))


def test_nodes_side_by_side_that_look_opposite_ways_are_joined_both_ways_where_the_way_round_is_long() -> None:
    images = there_and_back(count=8)
    edges = {(added.edge.source, added.edge.target): added.edge for added in turns(images)}
    assert (0, 150) in edges
    there, back = np.array(edges[0, 150].waypoint), np.array(edges[150, 0].waypoint)
    assert np.allclose(np.abs(there), [0.0, 0.2, np.pi])
    assert np.allclose(compose(there, back), 0, atol=1e-9)


def test_where_the_way_round_is_short_nothing_is_added() -> None:
    edges = {(added.edge.source, added.edge.target) for added in turns(there_and_back())}
    assert (50, 60) not in edges
    assert len(edges) <= 2 * 2


def test_where_a_wall_may_be_between_two_nodes_they_are_not_joined() -> None:
    assert turns(there_and_back(aside_m=0.5, count=8)) == []


def test_where_odometry_may_be_wrong_by_now_edges_are_doubted_and_in_the_end_there_are_none() -> None:
    long_way = [observation_at(np.array([42.0 - abs(42.0 - 0.6 * k), 0.0, 0.0]), 10 * k) for k in range(141)]
    added = {abs(each.edge.source - each.edge.target) * 0.06: each.edge.belief.p for each in turns(long_way)}
    assert {p for driven_m, p in added.items() if driven_m <= 10} == {0.8}
    assert {p for driven_m, p in added.items() if driven_m > 10} == {0.5}
    assert max(added) <= 60


HALL = (6.0, 4.0)
"""The size of the house of two rooms, whose wall stands at x = 3 with a doorway from y = 1.5 to 2.5."""


@pytest.fixture(scope="module")
def camera_robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SimulatedRobot]:
    """A robot in that house."""
    house = save(box_house(), tmp_path_factory.mktemp("house") / "house.glb")
    with closing(open_simulation(str(house), seed=0, odometry_noise=OdometryNoise.NONE).robot) as robot:
        yield robot


def seen_from(robot: SimulatedRobot, poses: Sequence[tuple[float, float, float]]) -> list[Observation]:
    """Return the images that the robot takes at these poses, and exact odometry."""
    images = list[Observation]()
    for k, pose in enumerate(poses):
        robot.teleport(np.array(pose))
        images.append(replace(robot.observe(), step=10 * k, stamp=float(k), odometry=np.array(pose)))
    return images


def joined(images: Sequence[Observation], source: int, target: int, space: NeededSpace = LOCOBOT.needed_space) -> bool:
    """Tell whether the floor between two of the images was seen free by them all, for a robot of some size."""
    gate = OdometryGate(images, ROBUST.building)
    waypoint = relative(images[source].odometry, images[target].odometry)
    floor = FreeFloor(images, LOCOBOT.camera, gate, space)
    return floor.joins(images[source].step, Matches.of_one(images[target].step, 0.8, waypoint))


def test_free_floor_joins_two_nodes_and_a_wall_does_not(camera_robot: SimulatedRobot) -> None:
    ahead = [(1.0, 1.0, 0.0), (2.2, 0.8, np.pi / 2), (2.2, 1.6, np.pi / 2), (2.2, 2.4, np.pi / 2)]
    images = seen_from(camera_robot, [*ahead, (2.4, 3.4, 0.0), (3.6, 3.4, np.pi), (3.6, 2.6, 0.0)])
    assert joined(images, 0, 1)
    assert joined(images, 1, 3)
    assert not joined(images, 4, 5)


def test_floor_that_no_image_shows_is_not_free(camera_robot: SimulatedRobot) -> None:
    away = seen_from(camera_robot, [(1.0, 1.0, np.pi), (1.0, 2.0, np.pi), (2.3, 2.0, 0.0), (2.3, 1.0, 0.0)])
    assert not joined(away, 0, 3)


@pytest.mark.parametrize("is_linked", [True, False])
def test_an_obstacle_that_another_drive_shows_keeps_nodes_apart_once_the_drives_are_linked(*, is_linked: bool) -> None:
    def seen(step: int, pose: Sequence[float], person: Sequence[float], odometry: Sequence[float]) -> Observation:
        depth = depth_of(one_room().walls, np.array(person), np.array(pose))
        return replace(observation_at(np.array(pose), step), depth=depth, odometry=np.array(odometry))

    nobody, person = (50.0, 50.0), (2.5, 2.0)
    facing = [seen(0, (1.5, 2.0, 0.0), nobody, (1.5, 2.0, 0.0)), seen(10, (3.5, 2.0, np.pi), nobody, (3.5, 2.0, np.pi))]
    across = [(2.5, 0.6, np.pi / 2), (2.5, 0.9, np.pi / 2)]
    later = [seen(20 + 10 * k, pose, person, (0.3 * k, 0.0, 0.0)) for k, pose in enumerate(across)]
    link = DriveLink(0, 20, relative(facing[0].odometry, np.array(across[0])))
    images = [*facing, *later]
    gate = OdometryGate(images, ROBUST.building, drive_starts=[20], links=[link] if is_linked else [])
    floor = FreeFloor(images, LOCOBOT.camera, gate, LOCOBOT.needed_space)
    joins = floor.joins(0, Matches.of_one(10, 0.8, np.array([2.0, 0.0, np.pi])))
    assert joins is not is_linked


@pytest.fixture(scope="module")
def hall_robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SimulatedRobot]:
    """A robot in the same house without the wall between the rooms."""
    hall = box_house()
    for name in list(hall.geometry)[-2:]:
        hall.delete_geometry(name)
    path = save(hall, tmp_path_factory.mktemp("hall") / "hall.glb")
    with closing(open_simulation(str(path), seed=0, odometry_noise=OdometryNoise.NONE).robot) as robot:
        yield robot


ALONG_WALLS = (
    *((0.6, y, np.pi / 2) for y in np.arange(1.6, 3.0, 0.55)),
    *((x, 3.2, 0.0) for x in np.arange(0.8, 5.0, 0.6)),
)


@pytest.mark.parametrize(
    ("end", "is_joined"),
    [(((5.0, 2.6, -np.pi / 2), (5.0, 2.0, -np.pi / 2), (5.0, 1.4, -np.pi / 2), (5.0, 1.0, 0.0)), True), ((), False)],
    ids=["around the hall", "along two walls"],
)
def test_a_long_edge_crosses_a_hall_only_where_the_way_round_is_much_longer(
    hall_robot: SimulatedRobot, end: tuple[tuple[float, float, float], ...], *, is_joined: bool
) -> None:
    stops = [*ALONG_WALLS, *end]
    heading = float(np.arctan2(stops[-1][1] - 1.0, stops[-1][0] - 0.6))
    images = seen_from(hall_robot, [(0.6, 1.0, heading), *stops])
    gate = OdometryGate(images, ROBUST.building)
    floor = FreeFloor(images, LOCOBOT.camera, gate, LOCOBOT.needed_space)
    edges = floor_edges(chain(images), gate, floor, ROBUST)
    assert any(np.hypot(*each.edge.waypoint[:2]) > 3 for each in edges) == is_joined


def seen_in_hall_with(
    folder: Path, bounds: Sequence[Sequence[float]], poses: Sequence[tuple[float, float, float]]
) -> list[Observation]:
    """Return the images of a hall in which a board hangs, or a thing stands."""
    hall = box_house()
    for name in list(hall.geometry)[-2:]:
        hall.delete_geometry(name)
    hall.add_geometry(trimesh.creation.box(bounds=bounds))
    path = save(hall, folder / "hall.glb")
    with closing(open_simulation(str(path), seed=0, odometry_noise=OdometryNoise.NONE).robot) as robot:
        return seen_from(robot, poses)


ACROSS = [(1.0, 2.0, 0.0), (1.6, 2.0, 0.0), (4.4, 2.0, np.pi), (5.0, 2.0, np.pi)]


@pytest.mark.parametrize(
    ("low_m", "top_m", "is_joined"),
    [
        (0.69, 0.72, {"locobot": False, "low": True}),
        (0.3, 0.34, {"locobot": False, "low": False}),
        (1.2, 1.3, {"locobot": True, "low": True}),
    ],
    ids=["a table", "a bench", "a lamp"],
)
def test_a_way_under_a_table_is_free_for_a_low_robot_alone(
    tmp_path: Path, low_m: float, top_m: float, is_joined: dict[str, bool]
) -> None:
    images = seen_in_hall_with(tmp_path, [[2.6, 1.2, low_m], [3.4, 2.8, top_m]], ACROSS)
    spaces = {"locobot": LOCOBOT.needed_space, "low": NeededSpace(0.18, 0.5)}
    assert {name: joined(images, 0, 3, space) for name, space in spaces.items()} == is_joined


def test_a_way_between_two_things_is_free_for_a_slim_robot_alone(tmp_path: Path) -> None:
    images = seen_in_hall_with(tmp_path, [[2.8, 2.5, 0.0], [3.2, 3.0, 1.0]], ACROSS)
    assert joined(images, 0, 3)
    assert not joined(images, 0, 3, NeededSpace(0.45, 0.9))


def test_a_thing_counts_however_long_ago_it_was_seen_from_its_other_side(tmp_path: Path) -> None:
    images = seen_in_hall_with(tmp_path, [[2.9, 1.9, 0.0], [3.1, 2.1, 0.5]], [*ACROSS, (3.0, 0.5, np.pi / 2)])
    before = [replace(seen, depth=_floor_without_things()) for seen in images[:4]]
    round_m = [(11.0 - abs(k - 6), 1.0 if k < 7 else 0.5, 0.0) for k in range(15)]
    way = [replace(images[0], step=100 + k, depth=None, odometry=np.array(pose)) for k, pose in enumerate(round_m)]
    assert joined([*before, *way], 0, 3)
    assert not joined([*before, *way, replace(images[4], step=200)], 0, 3)


def _floor_without_things() -> Depth:
    camera = LOCOBOT.camera
    down = (np.arange(camera.height) - camera.cy) / camera.fy
    with np.errstate(divide="ignore"):
        floor = np.where(down > 0, camera.height_m / down, 10.0)
    return np.repeat(floor[:, None], camera.width, axis=1).astype(np.float32)


def recognised(images: Sequence[Observation], pairs: Sequence[tuple[int, int]], off: Sequence[float]) -> CourseErrors:
    """Return the errors of a drive in which pairs of images are recognised `off` from where odometry has them."""
    graph = chain(list(images))
    for one, other in pairs:
        waypoint = relative(images[one].odometry, images[other].odometry) + off
        matches = Matches((images[other].step,), np.array([0.9]), waypoint[None], np.array([0.6]), np.ones(1, bool))
        for added in bidirectional_edges(images[one].step, matches, ROBUST.believing, Cause.BUILD):
            graph.apply(added)
    return CourseErrors(graph, OdometryGate(images, ROBUST.building))


def test_where_recognised_images_say_another_pose_than_odometry_nothing_rests_on_it() -> None:
    images = there_and_back(count=8)
    ends = images[1].step, images[14].step
    assert recognised(images, [(0, 14), (2, 14)], (2.0, 0.0, 0.0)).contradict(*ends)
    assert recognised(images, [(0, 14), (2, 14)], (0.0, 0.0, 0.6)).contradict(*ends)
    assert not recognised(images, [(0, 14), (2, 14)], (0.1, 0.0, 0.0)).contradict(*ends)
    assert not recognised(images, [(6, 9), (7, 9)], (2.0, 0.0, 0.0)).contradict(*ends)


def test_a_drive_whose_odometry_drifts_knows_places_over_a_shorter_way() -> None:
    images = there_and_back(count=16)
    pairs = [(k, 31 - k) for k in range(11)] + [(k, 30 - k) for k in range(11)]
    way_m = np.array([1.0, 4.0, 40.0, 200.0])
    assert recognised(images, [], (0.0, 0.0, 0.0)).know(way_m).tolist() == [True, True, True, False]
    assert recognised(images, pairs, (0.4, 0.0, 0.0)).know(way_m).tolist() == [True, True, False, False]


def test_a_place_that_is_not_known_well_needs_more_room(tmp_path: Path) -> None:
    images = seen_in_hall_with(tmp_path, [[2.8, 2.36, 0.0], [3.2, 3.0, 1.0]], ACROSS)
    gate = OdometryGate(images, ROBUST.building)
    floor = FreeFloor(images, LOCOBOT.camera, gate, LOCOBOT.needed_space)
    target = Matches.of_one(30, 0.8, relative(images[0].odometry, images[3].odometry))
    assert floor.joins(0, target)
    assert not floor.joins(0, target, error_m=0.4)
