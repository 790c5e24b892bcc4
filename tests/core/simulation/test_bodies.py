"""Both bodies, driven by the same commands through the same scenes, go the same way and feel the same walls."""

from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from itertools import pairwise, product

import numpy as np
import pytest
from numpy.typing import NDArray

from ltvn_core.errors import SceneError
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.simulation import body_selection
from ltvn_core.simulation.body import PERSON_RADIUS_M, TICKS_PER_SECOND, Body
from ltvn_core.simulation.body_selection import choose_body, open_body
from ltvn_core.simulation.planar_body import PlanarBody
from ltvn_core.simulation.scene_registry import load_scene
from ltvn_core.simulation.wheel_odometry import Drivetrain
from ltvn_core.types import Pose, Twist
from tests.core.simulation.two_room_mesh import box_house, save

NAMED = ("demo", "tune-1", "train-05", "plain-1", "office-0")
STARTS, SECONDS = 2, 6
BUMPER_S = 0.1
Triangles = tuple[NDArray[np.floating], NDArray[np.integer]]


@dataclass(frozen=True)
class Track:
    """What a body did: poses (T, 3) and whether its bumper was pressed (T,), tick by tick."""

    poses: NDArray[np.float64]
    pressed: NDArray[np.bool_]


def drive(body: Body, start: Pose, commands: list[Twist], seconds: float = 1.0) -> Track:
    """Drive by commands, each for the same time, with the motors between command and wheels."""
    body.place(start)
    wheels, poses, pressed = Drivetrain(LOCOBOT.accelerations), [], []
    for command in commands:
        for _ in range(round(seconds * TICKS_PER_SECOND)):
            body.tick(*wheels.follow(command, 1 / TICKS_PER_SECOND))
            poses.append((body.x_m, body.y_m, body.yaw_rad))
            pressed.append(body.in_contact)
    return Track(np.array(poses), np.array(pressed))


def assert_alike(bullet: Track, planar: Track) -> None:
    """Poses agree until something is touched; the bumper is pressed and free again at the same moments."""
    touched = bullet.pressed | planar.pressed
    until = int(touched.argmax()) if touched.any() else len(touched)
    gap = np.abs(bullet.poses - planar.poses)[:until]
    assert gap[:, :2].max(initial=0) < 0.02
    assert gap[:, 2].max(initial=0) < np.radians(1)
    assert_pressed_alike(bullet.pressed, planar.pressed)
    assert_pressed_alike(planar.pressed, bullet.pressed)


def assert_pressed_alike(first: NDArray[np.bool_], second: NDArray[np.bool_]) -> None:
    """Each moment at which one bumper is pressed lies within 0.1 s of one at which the other is."""
    ticks = round(BUMPER_S * TICKS_PER_SECOND)
    near = np.convolve(second, np.ones(2 * ticks + 1), mode="same") > 0
    assert not (first & ~near).any()


def both(triangles: Triangles, start: Pose) -> Iterator[Body]:
    for name in ("bullet", "planar"):
        with closing(open_body(name, *triangles, start, LOCOBOT)) as body:
            yield body


@pytest.fixture(scope="module", autouse=True)
def bullet() -> None:
    pytest.importorskip("pybullet")


@pytest.fixture(scope="module")
def mesh(tmp_path_factory: pytest.TempPathFactory) -> str:
    return str(save(box_house(), tmp_path_factory.mktemp("mesh") / "house.glb"))


def wall(angle_rad: float, *, lean: float = 0.0) -> Triangles:
    """Return a wall one metre from the origin that faces it from a direction; it may lean over the robot."""
    corners = np.array([[1, -6, 0], [1, 6, 0], [1 - lean, 6, 2], [1 - lean, -6, 2]], np.float64)
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return corners @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]]), np.array([[0, 1, 2], [0, 2, 3]])


def joined(*parts: Triangles) -> Triangles:
    first = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
    faces = [faces + begin for (_, faces), begin in zip(parts, first, strict=False)]
    return np.concatenate([vertices for vertices, _ in parts]), np.concatenate(faces)


NOTHING: Triangles = (np.zeros((0, 3)), np.zeros((0, 3), np.int64))


@pytest.mark.parametrize("name", [*NAMED, "mesh"])
def test_both_bodies_go_the_same_way_through_a_scene(name: str, mesh: str) -> None:
    scene = load_scene(mesh if name == "mesh" else name)
    rng = np.random.default_rng(3)
    starts = scene.clearance.sample_poses(rng, STARTS, min_clearance_m=0.25)
    ways = [[Twist(rng.uniform(-0.1, 0.5), rng.uniform(-0.8, 0.8)) for _ in range(SECONDS)] for _ in starts]
    bullet, planar = (
        [drive(body, *each) for each in zip(starts, ways, strict=True)]
        for body in both(scene.collision_triangles(), starts[0])
    )
    for tracks in zip(bullet, planar, strict=True):
        assert_alike(*tracks)


@pytest.mark.parametrize(
    ("degrees", "lean"),
    # In PyBullet friction at a leaning wall depends on its slope, which matters only beside the angle of friction.
    [*product((0, 8, 14, 20, 45, 75), (0.0,)), *product((0, 8, 45, 75), (0.5,))],
)
def test_both_bodies_stop_at_a_wall_head_on_and_slide_along_it_at_a_flat_angle(degrees: float, lean: float) -> None:
    start = np.array([0.5 * np.cos(np.radians(degrees)), 0.5 * np.sin(np.radians(degrees)), 0.0])
    bullet, planar = (
        drive(body, start, [Twist(0.4, 0.0)] * 4) for body in both(wall(np.radians(degrees), lean=lean), start)
    )
    assert planar.pressed.any()
    assert_alike(bullet, planar)
    assert np.abs(bullet.poses - planar.poses).max() < 0.03
    slid = np.hypot(*(planar.poses[-1] - planar.poses[-240])[:2])
    assert slid < 0.01 if degrees < 16 else slid > 0.02


@pytest.mark.parametrize("between_degrees", [60, 90, 130])
def test_both_bodies_get_stuck_in_a_corner_and_back_out_of_it(between_degrees: float) -> None:
    half = np.radians(180 - between_degrees) / 2
    corner = joined(wall(half), wall(-half))
    bullet, planar = (
        drive(body, np.array([-0.3, 0.1, 0.1]), [*[Twist(0.4, 0.0)] * 6, *[Twist(-0.4, 0.0)] * 2])
        for body in both(corner, np.zeros(3))
    )
    assert planar.pressed.any()
    assert not planar.pressed[-1]
    assert_alike(bullet, planar)
    assert np.abs(bullet.poses - planar.poses).max() < 0.03


@pytest.mark.parametrize("aside_m", [0.0, 0.1, 0.3])
def test_both_bodies_are_stopped_by_a_person_or_slide_past(aside_m: float) -> None:
    tracks = []
    for body in both(NOTHING, np.zeros(3)):
        body.set_people({"a": (1.0, aside_m)})
        tracks.append(drive(body, np.zeros(3), [Twist(0.4, 0.0)] * 4))
    assert tracks[1].pressed.any()
    assert_alike(*tracks)
    assert np.hypot(*(tracks[1].poses[:, :2] - (1.0, aside_m)).T).min() > PERSON_RADIUS_M + LOCOBOT.radius_m - 0.003


def test_both_bodies_are_pushed_out_of_what_appears_on_them() -> None:
    bullet, planar = (
        drive(body, np.array([0.9, 0.0, 0.0]), [Twist(0.0, 0.0)]) for body in both(wall(0.0), np.zeros(3))
    )
    assert np.abs(bullet.poses - planar.poses).max() < 0.005
    assert planar.poses[-1, 0] + LOCOBOT.radius_m < 1.001


def test_a_planar_body_finds_its_way_out_from_amid_a_table() -> None:
    table = np.array([[-0.6, -0.5, 0.5], [0.6, -0.5, 0.5], [0.6, 0.5, 0.5], [-0.6, 0.5, 0.5]])
    body = PlanarBody(table, np.array([[0, 1, 2], [0, 2, 3]]), np.array([0.1, 0.2, 0.0]), LOCOBOT)
    assert body.in_contact
    for _ in range(240):
        body.tick(0.0, 0.0)
    assert body.y_m > 0.5 + LOCOBOT.radius_m - 0.01


def test_a_planar_body_never_enters_what_it_drives_against() -> None:
    scene = load_scene("demo")
    rng = np.random.default_rng(9)
    start = scene.clearance.sample_poses(rng, 1, min_clearance_m=0.3)[0]
    body = PlanarBody(*scene.collision_triangles(), start, LOCOBOT)
    track = drive(body, start, [Twist(rng.uniform(-0.2, 0.5), rng.uniform(-1, 1)) for _ in range(40)])
    assert track.pressed.any()
    steps = [np.hypot(*(after - before)[:2]) for before, after in pairwise(track.poses)]
    assert max(steps) < 0.6 / TICKS_PER_SECOND
    assert scene.clearance.at(track.poses[:, :2]).min() > LOCOBOT.radius_m - 0.06  # The map rounds to cells.


def test_an_obstacle_that_is_taken_away_stops_nobody() -> None:
    body = PlanarBody(*wall(0.0), np.zeros(3), LOCOBOT)
    stopped = drive(body, np.zeros(3), [Twist(0.5, 0.0)] * 4)
    body.set_obstacles("scene", *NOTHING)
    assert stopped.pressed.any()
    assert not drive(body, np.zeros(3), [Twist(0.5, 0.0)] * 4).pressed.any()


def test_without_pybullet_auto_is_planar_and_bullet_names_what_else_there_is(monkeypatch: pytest.MonkeyPatch) -> None:
    assert choose_body("auto") == "bullet"
    monkeypatch.setattr(body_selection, "_bullet_missing", lambda: "it is not installed")
    assert choose_body("auto") == "planar"
    with pytest.raises(SceneError, match="--body planar"):
        choose_body("bullet")
