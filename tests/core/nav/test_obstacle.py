"""The depth image stops the robot for what stands in its way, and for nothing else."""

import numpy as np

from ltvn_core.nav.obstacle import free_ahead_m, is_blocked, points
from ltvn_core.types import Intrinsics

LENS = Intrinsics()


def scene(*boxes: tuple[float, float, float, float]) -> np.ndarray:
    """Return the depth of a floor and upright posts (distance, left edge, right edge, height)."""
    rows, columns = np.mgrid[0:72, 0:96]
    left = -(columns + 0.5 - 48) / LENS.focal_px
    up = -(rows + 0.5 - 36) / LENS.focal_px
    depth = np.where(up < 0, LENS.height_m / np.maximum(-up, 1e-6), 8.0)
    for away, left_edge, right_edge, height in boxes:
        hit = (left * away < left_edge) & (left * away > right_edge) & (up * away + LENS.height_m < height)
        depth = np.where(hit & (away < depth), away, depth)
    return np.where(depth < 8.0, depth, 0.0).astype(np.float32)


def test_an_empty_floor_is_free() -> None:
    assert free_ahead_m(scene(), LENS, 0.23) == np.inf


def test_the_nearest_thing_in_the_swept_width_counts() -> None:
    view = scene((1.5, 0.1, -0.1, 0.5), (0.9, 0.3, 0.1, 0.6))
    assert np.isclose(free_ahead_m(view, LENS, 0.23), 0.9)


def test_a_door_frame_beside_the_way_does_not_stop_the_robot() -> None:
    view = scene((0.8, 1.0, 0.35, 2.0), (0.8, -0.35, -1.0, 2.0))
    assert not is_blocked(view, LENS, ahead_m=0.9, margin_m=0.05)


def test_a_wall_stops_it_in_time_and_not_before() -> None:
    wall = scene((1.0, 5.0, -5.0, 3.0))
    assert is_blocked(wall, LENS, ahead_m=0.8, margin_m=0.05)
    assert not is_blocked(wall, LENS, ahead_m=0.7, margin_m=0.05)


def test_a_lamp_overhead_does_not_stop_it() -> None:
    depth = scene()
    depth[:20] = 1.0  # So near, the upper rows are higher than the robot.
    assert points(depth, LENS)[:, 2].max() > 0.65
    assert not is_blocked(depth, LENS, ahead_m=1.5, margin_m=0.05)


def test_missing_returns_and_two_stray_pixels_stop_nothing() -> None:
    depth = np.zeros((72, 96), np.float32)
    depth[40, 48] = depth[41, 48] = 0.5
    assert not is_blocked(depth, LENS, ahead_m=2.0, margin_m=0.05)


def test_points_lie_where_the_camera_sees_them() -> None:
    depth = np.zeros((72, 96), np.float32)
    depth[36, 10] = 2.0
    x, y, z = points(depth, LENS)[0]
    assert x == 2.0
    assert y > 0  # The left half of the picture is on the left.
    assert abs(z - LENS.height_m) < 0.03
