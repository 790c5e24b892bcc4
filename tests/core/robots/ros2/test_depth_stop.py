"""The depth stop: forward motion is allowed only while fresh depth shows the corridor ahead free."""

import time
from collections.abc import Callable

import numpy as np
import pytest

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.errors import RobotError
from ltvn_core.robots.ros2.depth_stop import DepthStop
from ltvn_core.robots.ros2.profile import RobotProfile, open_profile
from ltvn_core.robots.ros2.ros_messages import camera_info_message, image_message
from ltvn_core.robots.ros2.topic_keys import Attachment
from ltvn_core.robots.ros2.zenoh_link import Received
from ltvn_core.types import Depth, Twist

AHEAD = Twist(0.2, 0.0)
ROOM_M = np.array([[-2.0, -2.0, 0.0], [3.0, 2.0, 2.5]])
LENS = CameraModel.from_fov(160, 120, 1.2)
ROBOTS = ("turtlebot4", "locobot", "nav2")
GID = bytes(16)


def room_depth(profile: RobotProfile, room_m: np.ndarray = ROOM_M, lens: CameraModel = LENS) -> Depth:
    """What the camera of a robot sees in an empty room, of which it is the origin."""
    camera = profile.mounted(lens)
    pixels = np.stack(np.meshgrid(np.arange(camera.width), np.arange(camera.height)), axis=-1)
    eye = np.array([0.0, 0.0, camera.height_m])
    rays = camera.unproject(pixels, np.ones(pixels.shape[:2])) - eye
    with np.errstate(divide="ignore"):
        return (np.where(rays > 0, room_m[1] - eye, room_m[0] - eye) / rays).min(axis=-1).astype(np.float32)


def verdict(profile: RobotProfile, depth: Depth, lens: CameraModel = LENS) -> str | None:
    """Why a robot that sees this may not drive forwards; None if it may."""
    stop = DepthStop(profile, 0.3)
    stop.take_camera_info(Received(camera_info_message(lens, 1.0), Attachment(1, 1, GID), 0.0))
    stop.take_depth(Received(image_message(depth, 1.0), Attachment(1, 1, GID), time.monotonic()))
    assert (stop.allows(AHEAD) == AHEAD) == (stop.reason is None)
    return stop.reason


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("missing", [0.0, 0.2, 0.4])
def test_a_room_with_scattered_missing_depth_is_free(name: str, missing: float) -> None:
    depth = room_depth(open_profile(name))
    depth[np.random.default_rng(0).random(depth.shape) < missing] = 0
    assert verdict(open_profile(name), depth) is None


@pytest.mark.parametrize("name", ROBOTS)
def test_small_holes_and_a_blind_edge_do_not_stop_a_robot(name: str) -> None:
    depth = room_depth(open_profile(name))
    depth[:, :8] = 0
    for row, column in ((20, 40), (60, 75), (80, 120)):
        depth[row : row + 14, column : column + 14] = 0
    assert verdict(open_profile(name), depth) is None


def middle(depth: Depth) -> None:
    depth[20:100, 30:130] = 0


def all_but_a_speckle(depth: Depth) -> None:
    speckle = depth[4, 5]
    depth[:] = 0
    depth[4, 5] = speckle


def all_but_the_ceiling(depth: Depth) -> None:
    depth[4:] = 0


def left_half(depth: Depth) -> None:
    depth[:, :80] = 0


def lower_half(depth: Depth) -> None:
    depth[60:] = 0


def a_box_before_the_right_wheel(depth: Depth) -> None:
    depth[60:, 90:130] = 0


def most_of_it(depth: Depth) -> None:
    depth[np.random.default_rng(0).random(depth.shape) < 0.9] = 0


@pytest.mark.parametrize(
    "hide",
    [
        middle,
        all_but_a_speckle,
        all_but_the_ceiling,
        left_half,
        lower_half,
        a_box_before_the_right_wheel,
        most_of_it,
    ],
)
@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("nothing", [0.0, np.nan, np.inf])
def test_a_part_of_the_corridor_that_is_not_seen_stops_a_robot(
    name: str, hide: Callable[[Depth], None], nothing: float
) -> None:
    depth = room_depth(open_profile(name))
    hide(depth)
    depth[depth == 0] = nothing
    assert "does not show" in str(verdict(open_profile(name), depth))


def test_sixteen_bits_that_are_all_ones_are_no_return() -> None:
    profile = open_profile("turtlebot4")
    message = image_message(np.full((120, 160), 65.535, np.float32), 1.0)
    units = np.full((120, 160), 65535, np.uint16)
    message.encoding, message.step, message.data = "16UC1", 320, units.view(np.uint8).ravel()
    stop = DepthStop(profile, 0.3)
    stop.take_camera_info(Received(camera_info_message(LENS, 1.0), Attachment(1, 1, GID), 0.0))
    stop.take_depth(Received(message, Attachment(1, 1, GID), time.monotonic()))
    assert "empty" in str(stop.reason)


def test_a_wall_within_the_distance_stops_a_robot() -> None:
    near = ROOM_M.copy()
    near[1, 0] = 0.45
    profile = open_profile("turtlebot4")
    assert "obstacle 0.26 m" in str(verdict(profile, room_depth(profile, near)))


@pytest.mark.parametrize(
    ("name", "up_m", "stops"),
    [("locobot", 0.72, True), ("locobot", 0.82, True), ("nav2", 0.57, True), ("nav2", 0.64, False)],
)
def test_what_hangs_in_the_way_stops_a_robot_that_does_not_fit_below(name: str, up_m: float, *, stops: bool) -> None:
    profile = open_profile(name)
    depth = room_depth(profile)
    camera = profile.mounted(LENS)
    ahead_m = profile.body.radius_m + 0.27
    pixels = np.stack(np.meshgrid(np.arange(camera.width), np.arange(camera.height)), axis=-1)
    up = camera.unproject(pixels, np.full(pixels.shape[:2], ahead_m))[..., 2]
    assert (np.abs(up - up_m) < 0.01).any()
    depth[np.abs(up - up_m) < 0.01] = ahead_m
    assert ("obstacle" in str(verdict(profile, depth))) == stops


def test_a_camera_that_does_not_see_the_corridor_allows_nothing() -> None:
    profile = open_profile("turtlebot4")
    narrow = CameraModel.from_fov(160, 120, 0.3)
    assert "sees only" in str(verdict(profile, room_depth(profile, lens=narrow), narrow))


def test_late_depth_is_refused_and_its_delay_counts_as_age() -> None:
    profile = open_profile("turtlebot4")
    depth = room_depth(profile)
    stop = DepthStop(profile, 0.3)
    stop.take_camera_info(Received(camera_info_message(LENS, 1.0), Attachment(1, 1, GID), 0.0))
    begun_s = time.monotonic() - 10.0

    def take(number: int, taken_s: float, arrived_s: float) -> None:
        # The driver sends at once what it took long ago.
        sent = Attachment(number, round((1000.0 + arrived_s) * 1e9), GID)
        stop.take_depth(Received(image_message(depth, 1000.0 + taken_s), sent, begun_s + arrived_s))

    take(1, 0.0, 0.0)
    with pytest.raises(RobotError, match="late"):
        take(2, 8.0, 10.0)
    assert stop.allows(AHEAD).linear_m_s == 0
    take(3, 10.0, 10.0)
    assert stop.allows(AHEAD) == AHEAD
    take(4, 9.5, 9.9)
    assert stop.allows(AHEAD).linear_m_s == 0
    assert "recent" in str(stop.reason)


def test_without_a_lens_the_reason_says_so() -> None:
    stop = DepthStop(open_profile("turtlebot4"), 0.3)
    depth = image_message(room_depth(open_profile("turtlebot4")), 1.0)
    stop.take_depth(Received(depth, Attachment(1, 1, GID), time.monotonic()))
    assert "CameraInfo" in str(stop.reason)
