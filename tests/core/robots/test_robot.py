"""What a robot is made of: its spec, its clock, and the camera that the rest of the program looks through."""

from dataclasses import replace

import numpy as np
import pytest

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.errors import OptionError
from ltvn_core.robots.robot import WallClock
from ltvn_core.robots.robot_spec import LOCOBOT, NeededSpace
from ltvn_core.robots.robot_view import fit_camera
from ltvn_core.types import Observation, Twist
from tests.core.flat_world import FlatRobot, one_room

KINECT = CameraModel.from_fov(640, 480, np.deg2rad(80), height_m=0.3)


class KinectRobot(FlatRobot):
    """A robot with a camera of its own."""

    spec = replace(LOCOBOT, camera=KINECT)

    def observe(self) -> Observation:
        colours = np.full((480, 640, 3), 100, np.uint8)
        return replace(super().observe(), rgb=colours, depth=np.full((480, 640), 2, np.float32))


def test_a_robot_of_another_camera_shows_what_the_predictor_asks_for() -> None:
    robot = fit_camera(KinectRobot(one_room(), (1, 1, 0)), LOCOBOT.camera)
    seen = robot.observe()
    assert (seen.rgb.shape, seen.require_depth("the test").shape) == ((72, 96, 3), (72, 96))
    assert robot.spec.camera == replace(LOCOBOT.camera, height_m=0.3)
    assert seen.original is not None
    assert (seen.original.camera.width, seen.original.camera.height) == (320, 240)


def test_a_robot_whose_camera_fits_is_left_alone() -> None:
    robot = FlatRobot(one_room(), (1, 1, 0))
    assert fit_camera(robot, LOCOBOT.camera) is robot


def test_everything_but_its_images_comes_from_the_robot_itself() -> None:
    robot = KinectRobot(one_room(), (1, 1, 0))
    fitted = fit_camera(robot, LOCOBOT.camera, original_size=None)
    fitted.drive(Twist(0.3, 0.0))
    fitted.clock.advance(0.5)
    assert robot.pose[0] == pytest.approx(1.15)
    assert fitted.state().stamp == robot.state().stamp
    fitted.stop()
    assert robot.stops == 1
    assert fitted.observe().original is None


def test_a_loop_on_the_walls_clock_waits_for_what_is_left_of_its_turn() -> None:
    now, waited = [100.0], []

    def sleep(duration_s: float) -> None:
        waited.append(duration_s)
        now[0] += duration_s

    clock = WallClock(lambda: now[0], sleep)
    now[0] += 0.03
    clock.advance(0.1)
    assert waited == pytest.approx([0.07])
    now[0] += 0.5  # A turn that took too long is not made up for.
    clock.advance(0.1)
    clock.advance(0.1)
    assert waited == pytest.approx([0.07, 0.1])
    assert clock.now() == pytest.approx(0.7)


def test_what_is_kept_free_around_a_robot_is_its_radius_rounded_up() -> None:
    assert LOCOBOT.clear_radius_m == 0.18
    assert replace(LOCOBOT, radius_m=0.2).clear_radius_m == 0.2


@pytest.mark.parametrize("change", [{"radius_m": 0.0}, {"radius_m": float("nan")}, {"ground_clearance_m": 1.0}])
def test_a_robot_without_size_is_refused(change: dict[str, float]) -> None:
    with pytest.raises(OptionError, match="LoCoBot: a robot needs a radius"):
        replace(LOCOBOT, **change)


def test_an_unknown_robot_is_as_large_as_a_locobot_but_no_lower_than_its_camera() -> None:
    assert NeededSpace.assumed(LOCOBOT.camera) == LOCOBOT.needed_space
    held = NeededSpace.assumed(replace(LOCOBOT.camera, height_m=1.3))
    assert held.radius_m == LOCOBOT.clear_radius_m
    assert 1.3 < held.height_m < 1.5


def test_the_space_of_a_robot_is_read_back_from_the_settings_of_its_recording() -> None:
    space = NeededSpace(0.25, 0.6)
    assert NeededSpace.recorded({"verb": "collect", **space.to_config()}) == space
    for wrong in ({}, {"needed_space": 3}, {"needed_space": {"radius_m": -1, "height_m": 2}}, {"needed_space": {}}):
        assert NeededSpace.recorded(wrong) is None
