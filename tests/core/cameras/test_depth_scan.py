"""What a depth image shows free: no farther than it saw, and nothing where it saw nothing."""

import numpy as np
import pytest

from ltvn_core.cameras.depth_scan import RANGE_M, DepthScan
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.types import Depth

LENS = LOCOBOT.camera
UP = -(np.arange(LENS.height) - LENS.cy) / LENS.fy
AHEAD = np.array([0.0])


def room(wall_m: float = 10.0, ceiling_m: float = 2.5) -> Depth:
    """Return what the camera sees of a floor, a wall ahead and a ceiling."""
    with np.errstate(divide="ignore"):
        ends = np.where(UP < 0, -LENS.height_m / UP, (ceiling_m - LENS.height_m) / UP)
    return np.repeat(np.minimum(ends, wall_m)[:, None], LENS.width, axis=1).astype(np.float32)


def scan(depth: Depth, height_m: float = LOCOBOT.clear_height_m) -> DepthScan:
    points = LENS.unproject_image(np.where(depth < RANGE_M, depth, 0.0))
    return DepthScan.of(LENS, 0.0, np.zeros(3), points, height_m)


def is_free(depth: Depth, away_m: float, height_m: float = LOCOBOT.clear_height_m) -> bool:
    return bool(scan(depth, height_m).shows_past(AHEAD, np.array([away_m]))[0])


def test_floor_that_is_seen_is_free_up_to_where_it_is_seen() -> None:
    assert is_free(room(), 3.0)
    assert is_free(room(wall_m=3.2), 3.0)
    assert not is_free(room(wall_m=3.2), 3.3)


def test_a_column_that_shows_only_the_ceiling_says_nothing_about_the_floor() -> None:
    depth = room(ceiling_m=1.6)
    depth[UP < 0.3] = 0.0
    assert (depth > 0).any()
    assert not is_free(depth, 0.5)
    assert not scan(depth).shown_m.any()


@pytest.mark.parametrize("at_m", [1.5, 2.0, 2.5])
def test_behind_an_opening_without_depth_the_floor_is_unknown(at_m: float) -> None:
    window = room(ceiling_m=2.2)
    window[(-LENS.height_m / at_m < UP) & (UP < 0.3)] = 0.0
    assert is_free(window, 1.2)
    assert not is_free(window, at_m + 0.1)


def test_something_black_hides_the_floor_in_front_of_the_wall_that_is_seen_above_it() -> None:
    depth = room(wall_m=3.5)
    depth[(UP > -0.4) & (UP < -0.1)] = 0.0
    assert not is_free(depth, 2.5)


def test_single_pixels_without_depth_hide_nothing() -> None:
    depth = room()
    depth[np.random.default_rng(0).random(depth.shape) < 0.2] = 0.0
    free = scan(depth).shown_m
    assert np.median(free) > 3.0


def test_what_hangs_between_a_low_and_a_high_robot_is_an_obstacle_to_the_high_one_alone() -> None:
    depth = room()
    depth[(UP > 0.02) & (UP < 0.1)] = 2.0
    assert not is_free(depth, 2.5)
    assert is_free(depth, 2.5, height_m=0.5)
