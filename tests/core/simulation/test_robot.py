"""The simulated robot cannot pass walls, stands when nobody drives it, and never gives one name to two pictures."""

import threading
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from ltvn_core.errors import SceneError
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.simulation.body import TICK_S
from ltvn_core.simulation.scene_registry import Scene, load_scene
from ltvn_core.simulation.simulated_robot import SimulatedRobot
from ltvn_core.simulation.wheel_odometry import OdometryNoise
from ltvn_core.types import CONTROL_STEP_S, ZERO_TWIST, Pose, Twist
from tests.core.simulation.fake_scene import GreyCamera

FULL_SPEED = Twist(0.5, 0.0)
STOPPING_S = 0.3
"""From the last drive command to standing still: a lease of 250 ms and braking."""

Launch = Callable[..., SimulatedRobot]


@pytest.fixture(scope="module")
def scene() -> Scene:
    return load_scene("train-00")


@pytest.fixture(scope="module")
def start(scene: Scene) -> Pose:
    """A place with more than a metre of free way ahead, some behind, and then a wall that the robot meets head on."""
    poses = scene.clearance.sample_poses(np.random.default_rng(0), 2000, min_clearance_m=0.7)
    poses[:, 2] = 0.0
    behind, ahead = poses[:, :2] - (0.8, 0.0), poses[:, :2] + (1.2, 0.0)
    open_way = scene.clearance.along(behind, ahead) > 0.35
    return next(pose for pose in poses[open_way] if _meets_a_wall(scene, pose))


def _meets_a_wall(scene: Scene, pose: Pose) -> bool:
    """Tell whether what lies ahead along x is flat for as wide as the robot is, and more."""
    x, aside = np.arange(0.0, 8.0, 0.05), np.linspace(-0.3, 0.3, 13)
    places = pose[:2] + np.stack(np.meshgrid(x, aside, indexing="ij"), axis=-1)
    solid = scene.clearance.at(places.reshape(-1, 2)).reshape(len(x), -1) == 0
    return len({int(first) for first in solid.argmax(axis=0)}) == 1


@pytest.fixture
def launch(scene: Scene, start: Pose) -> Iterator[Launch]:
    """Put robots into the scene, and clear them away at the end."""
    robots: list[SimulatedRobot] = []

    def _launch(at: Pose | None = None, *, first_step: int = 0, camera: GreyCamera | None = None) -> SimulatedRobot:
        rng = np.random.default_rng(0)
        place = start if at is None else at
        noise = OdometryNoise.NONE
        robots.append(
            SimulatedRobot(
                scene, camera or GreyCamera(), start=place, rng=rng, odometry_noise=noise, first_step=first_step
            )
        )
        return robots[-1]

    yield _launch
    for robot in robots:
        robot.close()


@pytest.fixture
def robot(launch: Launch) -> SimulatedRobot:
    return launch()


def test_a_robot_driven_at_random_never_enters_an_obstacle(launch: Launch, scene: Scene) -> None:
    rng, collisions = np.random.default_rng(7), 0
    for start in scene.clearance.sample_poses(rng, 6):
        robot = launch(start)
        for _ in range(20):
            twist = Twist(float(rng.choice([0.5, 0.5, -0.5])), float(rng.uniform(-0.6, 0.6)))
            for _ in range(int(rng.integers(5, 40))):
                robot.drive(twist)
                robot.advance(CONTROL_STEP_S)
                assert scene.clearance.at(robot.exact_pose[:2]) >= LOCOBOT.radius_m - 0.03
        collisions += robot.collisions
        # Nobody gets out of the piece of floor on which he began.
        assert scene.clearance.path(start[:2], robot.exact_pose[:2]) is not None
    assert collisions > 10


def test_driving_into_a_wall_is_one_collision_and_the_bumper_stays_pressed(robot: SimulatedRobot) -> None:
    _drive(robot, FULL_SPEED, 10.0)
    assert robot.collisions == 1
    assert robot.state().bumper_pressed
    _drive(robot, FULL_SPEED, 2.0)
    assert robot.collisions == 1


def test_touching_again_after_backing_off_is_another_collision(robot: SimulatedRobot) -> None:
    _drive(robot, FULL_SPEED, 10.0)
    _drive(robot, Twist(-0.3, 0.0), 1.5)
    assert not robot.state().bumper_pressed
    _drive(robot, FULL_SPEED, 5.0)
    assert robot.collisions == 2


def test_the_robot_drives_as_far_as_its_speed_says(robot: SimulatedRobot, start: Pose) -> None:
    _drive(robot, Twist(0.3, 0.0), 3.0)
    # Up to its speed it needs 0.2 s.
    assert np.hypot(*(robot.exact_pose - start)[:2]) == pytest.approx(0.9 - 0.03, abs=0.01)


def test_the_robot_turns_counter_clockwise_for_a_positive_rate(robot: SimulatedRobot, start: Pose) -> None:
    _drive(robot, Twist(0.0, 0.5), 1.0)
    turned = (robot.exact_pose[2] - start[2] + np.pi) % (2 * np.pi) - np.pi
    assert turned == pytest.approx(0.5 - 0.02, abs=0.01)
    assert robot.exact_pose[:2] == pytest.approx(start[:2], abs=1e-6)


@pytest.mark.parametrize("twist", [FULL_SPEED, Twist(-0.5, 0.0), Twist(0.0, 1.0), Twist(0.5, -1.0)])
def test_the_robot_stands_300_ms_after_the_last_drive_command(robot: SimulatedRobot, twist: Twist) -> None:
    _drive(robot, twist, 1.0)
    robot.drive(twist)
    robot.advance(STOPPING_S)
    stands = robot.exact_pose
    assert robot.speeds == ZERO_TWIST
    robot.advance(2.0)
    assert np.array_equal(robot.exact_pose, stands)


def test_stop_brakes_at_once(robot: SimulatedRobot) -> None:
    _drive(robot, FULL_SPEED, 1.0)
    robot.drive(FULL_SPEED)
    before = robot.exact_pose
    robot.stop()
    robot.advance(0.05)
    assert robot.speeds == ZERO_TWIST
    assert np.hypot(*(robot.exact_pose - before)[:2]) < 0.02
    stands = robot.exact_pose
    robot.advance(1.0)
    assert np.array_equal(robot.exact_pose, stands)


def test_stop_from_another_thread_stops(robot: SimulatedRobot) -> None:
    _drive(robot, FULL_SPEED, 0.5)
    thread = threading.Thread(target=robot.stop)
    thread.start()
    thread.join()
    robot.advance(0.05)
    assert robot.speeds == ZERO_TWIST


def test_control_steps_and_the_clock_follow_robot_time(robot: SimulatedRobot) -> None:
    for _ in range(30):  # A page's frames do not divide a control step.
        robot.advance(1 / 30)
    assert robot.stamp == pytest.approx(1.0, abs=TICK_S)
    assert robot.step == 10
    robot.advance(0.0)
    assert robot.stamp == pytest.approx(1.0, abs=TICK_S)
    assert robot.state().step == robot.step


def test_how_time_is_cut_into_pieces_changes_nothing(launch: Launch) -> None:
    whole, pieces = launch(), launch()
    for robot, cuts in ((whole, 1), (pieces, 7)):
        for _ in range(20):
            robot.drive(Twist(0.4, 0.3))
            for _ in range(cuts):
                robot.advance(CONTROL_STEP_S / cuts)
    assert pieces.step == whole.step
    assert pieces.exact_pose == pytest.approx(whole.exact_pose, abs=5e-3)


@pytest.mark.parametrize("duration_s", [-0.1, float("nan"), float("inf")])
def test_time_only_moves_forward(robot: SimulatedRobot, duration_s: float) -> None:
    with pytest.raises(ValueError, match="only moves forward"):
        robot.advance(duration_s)


def test_looking_twice_in_a_step_gives_the_same_image(launch: Launch) -> None:
    camera = GreyCamera()
    robot = launch(camera=camera)
    first = robot.observe()
    robot.advance(CONTROL_STEP_S / 2)
    assert robot.observe() is first
    assert camera.renders == 1
    robot.advance(CONTROL_STEP_S / 2)
    assert robot.observe().step == first.step + 1


def test_a_robot_that_stands_still_renders_nothing_anew_and_one_that_moved_does(launch: Launch) -> None:
    camera = GreyCamera()
    robot = launch(camera=camera)
    for _ in range(3):
        robot.observe()
        robot.advance(CONTROL_STEP_S)
    assert camera.renders == 1
    robot.drive(Twist(0.3, 0.0))
    robot.advance(CONTROL_STEP_S)
    robot.observe()
    assert camera.renders == 2


def test_two_different_images_never_share_a_step(launch: Launch, scene: Scene) -> None:
    robot = launch()
    rng = np.random.default_rng(3)
    poses = scene.clearance.sample_poses(rng, 10)
    observations = []
    for pose in poses:
        observations.append(robot.observe())
        robot.teleport(pose)
        observations.append(robot.observe())
        _drive(robot, Twist(0.2, 0.4), 0.15)
        observations.append(robot.observe())
    by_step = {}
    for observation in observations:
        assert by_step.setdefault(observation.step, observation) is observation
    assert [observation.step for observation in observations] == sorted(
        observation.step for observation in observations
    )


def test_an_image_says_where_and_when_it_was_taken(robot: SimulatedRobot) -> None:
    _drive(robot, Twist(0.2, 0.3), 1.0)
    seen = robot.observe()
    assert seen.exact_pose is not None
    assert np.array_equal(seen.exact_pose, robot.exact_pose)
    assert np.array_equal(seen.odometry, robot.state().odometry)
    assert (seen.stamp, seen.step) == (robot.stamp, robot.step)


def test_counting_goes_on_from_the_first_step(launch: Launch) -> None:
    robot = launch(first_step=500)
    assert robot.observe().step == 500
    assert robot.stamp == pytest.approx(50.0)
    robot.advance(CONTROL_STEP_S)
    assert robot.observe().step == 501


def test_a_lifted_robot_stands_at_its_new_place_and_its_odometry_restarts(robot: SimulatedRobot, scene: Scene) -> None:
    _drive(robot, FULL_SPEED, 0.5)
    robot.drive(FULL_SPEED)
    goal = scene.clearance.sample_poses(np.random.default_rng(5), 1)[0]
    stamp = robot.stamp
    robot.teleport(goal)
    robot.advance(1.0)
    assert robot.exact_pose == pytest.approx(goal)
    assert robot.state().odometry == pytest.approx(goal)
    assert robot.stamp > stamp


def test_nobody_is_put_into_an_obstacle(launch: Launch, robot: SimulatedRobot, scene: Scene) -> None:
    row, column = np.argwhere(scene.clearance.blocked)[0]
    wall = np.array([*(scene.clearance.origin + (np.array([column, row]) + 0.5) * 0.05), 0.0])
    before = robot.exact_pose
    for place in (wall, np.array([-50.0, 0.0, 0.0])):
        with pytest.raises(SceneError, match="cannot stand"):
            robot.teleport(place)
        with pytest.raises(SceneError, match="cannot stand"):
            launch(place)
    assert np.array_equal(robot.exact_pose, before)


@pytest.mark.parametrize("pose", [[0.0, 0.0], [np.nan, 0.0, 0.0], [0.0, 0.0, np.inf]])
def test_a_pose_is_three_finite_numbers(robot: SimulatedRobot, pose: list[float]) -> None:
    with pytest.raises(ValueError, match="three finite numbers"):
        robot.teleport(np.array(pose))


def test_a_person_may_look_through_another_lens(robot: SimulatedRobot) -> None:
    seen = robot.observe()
    rgb, depth = robot.render(LOCOBOT.camera.scaled(320, 240))
    assert rgb.shape == (240, 320, 3)
    assert depth.shape == (240, 320)
    assert robot.observe() is seen
    assert seen.rgb.shape == (72, 96, 3)


def _drive(robot: SimulatedRobot, twist: Twist, duration_s: float) -> None:
    """Drive for a while, renewing the lease every control step."""
    for _ in range(round(duration_s / CONTROL_STEP_S)):
        robot.drive(twist)
        robot.advance(CONTROL_STEP_S)
