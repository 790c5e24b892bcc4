"""The depth images stop or bend the robot for what stands in its way, and for nothing else."""

from dataclasses import replace

import numpy as np
import pytest

from ltvn_core.cameras.depth_points import map_points, obstacle_points
from ltvn_core.config import ROBUST
from ltvn_core.navigation.bystanders import Bystanders
from ltvn_core.navigation.obstacle_memory import ObstacleMemory
from ltvn_core.navigation.steering import collision_free_command
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.types import Observation, Twist
from tests.core.flat_world import observation_at

LENS = LOCOBOT.camera
RADIUS_M, HEIGHT_M = LOCOBOT.clear_radius_m, LOCOBOT.clear_height_m
AHEAD = Twist(0.5, 0.0)
STRAIGHT = replace(ROBUST.driving, swerve=False)


def scene(*boxes: tuple[float, float, float, float]) -> np.ndarray:
    """Return the depth of a floor and upright posts (distance, left edge, right edge, height)."""
    rows, columns = np.mgrid[0:72, 0:96]
    left = -(columns + 0.5 - 48) / LENS.fx
    up = -(rows + 0.5 - 36) / LENS.fx
    depth = np.where(up < 0, LENS.height_m / np.maximum(-up, 1e-6), 8.0)
    for away, left_edge, right_edge, height in boxes:
        hit = (left * away < left_edge) & (left * away > right_edge) & (up * away + LENS.height_m < height)
        depth = np.where(hit & (away < depth), away, depth)
    return np.where(depth < 8.0, depth, 0.0).astype(np.float32)


def command(depth: np.ndarray, length_m: float = 2.0, twist: Twist = AHEAD) -> Twist | None:
    return collision_free_command(
        twist, obstacle_points(depth, LENS, height_m=HEIGHT_M), length_m, ROBUST.driving, radius_m=RADIUS_M
    )


def test_points_lie_where_the_camera_sees_them() -> None:
    assert len(obstacle_points(scene(), LENS, height_m=HEIGHT_M)) == 0
    points = obstacle_points(scene((0.9, 0.5, 0.3, 0.5)), LENS, height_m=HEIGHT_M)
    assert np.allclose(points[:, 0], 0.9)
    assert points[:, 1].min() > 0.28
    assert points[:, 1].max() < 0.52


def test_a_wall_across_the_way_stops_the_robot_in_time_and_not_before() -> None:
    wall = scene((0.5, 5.0, -5.0, 3.0))
    assert command(wall) is None
    assert command(wall, length_m=0.2) == AHEAD
    assert command(scene((1.2, 5.0, -5.0, 3.0))) == AHEAD


def test_a_door_frame_beside_the_way_does_not_bother_the_robot() -> None:
    assert command(scene((0.5, 1.0, 0.27, 2.0), (0.5, -0.27, -1.0, 2.0))) == AHEAD


def test_a_post_on_the_left_moves_the_detour_to_the_right() -> None:
    post = scene((0.45, 0.3, 0.12, 0.6))
    adjusted = command(post)
    assert adjusted is not None
    assert adjusted.angular_rad_s < 0
    assert 0 < adjusted.linear_m_s < AHEAD.linear_m_s
    assert (
        collision_free_command(AHEAD, obstacle_points(post, LENS, height_m=HEIGHT_M), 2.0, STRAIGHT, radius_m=RADIUS_M)
        is None
    )


def test_what_hangs_overhead_and_two_stray_pixels_stop_nothing() -> None:
    depth = scene()
    depth[:20] = 1.0
    depth[40, 48] = depth[42, 48] = 0.3
    assert command(depth) == AHEAD


def test_a_turn_on_the_spot_is_always_allowed() -> None:
    turn = Twist(0.0, 1.0)
    assert command(scene((0.2, 5.0, -5.0, 3.0)), twist=turn) == turn


def test_a_robot_too_near_to_something_may_leave_it() -> None:
    beside = np.array([[0.0, 0.19]] * 10)
    assert collision_free_command(AHEAD, beside, 1.0, STRAIGHT, radius_m=RADIUS_M) == AHEAD
    before = np.array([[0.19, 0.0]] * 10)
    assert collision_free_command(AHEAD, before, 1.0, STRAIGHT, radius_m=RADIUS_M) is None
    assert collision_free_command(Twist(-0.5, 0.0), before, 1.0, STRAIGHT, radius_m=RADIUS_M) == Twist(-0.5, 0.0)


def corridor(half_width_m: float) -> np.ndarray:
    """Return the depth of a floor between two long walls."""
    left = np.abs((np.mgrid[0:72, 0:96][1] + 0.5 - 48) / LENS.fx)
    walls = half_width_m / left
    floor = scene()
    return np.where((floor == 0) | (walls < floor), np.where(walls < 8.0, walls, 0.0), floor).astype(np.float32)


@pytest.mark.parametrize("seed", range(5))
def test_walls_in_many_noisy_depth_images_stay_where_they_are(seed: int) -> None:
    rng = np.random.default_rng(seed)
    obstacles = ObstacleMemory(LOCOBOT)
    for k in range(12):
        depth = corridor(0.22) * rng.normal(1.0, 0.02, (72, 96))
        obstacles.add(replace(observation_at(np.array([0.1 * k, 0.0, 0.0]), k), depth=depth.astype(np.float32)))
    aside = np.sort(np.abs(obstacles.nearby_points(np.array([1.1, 0.0, 0.0]))[:, 1]))
    assert aside[2] > 0.22 - 0.012, "avoidance takes the third nearest point for the wall"


def seen_from(x_m: float, step: int, box_m: float = 0.6) -> Observation:
    """Return an image of a box, lower than the camera, before a wall, taken at x and `step` seconds."""
    depth = scene((3.0 - x_m, 5.0, -5.0, 3.0), (box_m - x_m, 0.3, -0.3, 0.35))
    return replace(observation_at(np.array([x_m, 0.0, 0.0]), step), depth=depth, stamp=float(step))


def test_a_low_box_is_remembered_when_the_camera_sees_over_it() -> None:
    obstacles = ObstacleMemory(LOCOBOT)
    obstacles.add(seen_from(0.0, 1))
    obstacles.add(seen_from(0.32, 2))
    points = obstacles.nearby_points(np.array([0.32, 0.0, 0.0]))
    assert (np.abs(points - (0.28, 0.0)) < (0.03, 0.1)).all(axis=1).sum() > 8

    obstacles.add(seen_from(0.0, 3, box_m=2.9))
    assert (obstacles.nearby_points(np.zeros(3))[:, 0] > 1.0).all(), "it was carried away"


def test_a_low_box_has_not_moved_when_a_robot_that_saw_over_it_sees_it() -> None:
    bystanders = Bystanders()
    obstacles = ObstacleMemory(LOCOBOT, bystanders=bystanders)
    obstacles.add(seen_from(0.32, 1))
    obstacles.add(seen_from(0.0, 2))
    assert not obstacles.moves_ahead(np.zeros(3))
    assert not bystanders.are_about(2.0)

    obstacles.add(seen_from(0.0, 3, box_m=0.95))
    assert bystanders.are_about(3.0), "it was pushed to where the floor was seen"


def test_a_leg_before_a_wall_is_kept_and_two_stray_pixels_are_not() -> None:
    obstacles = ObstacleMemory(LOCOBOT)
    depth = scene((1.2, 5.0, -5.0, 3.0), (0.6, 0.03, -0.03, 0.4))
    depth[40, 20] = depth[44, 20] = 0.3
    obstacles.add(replace(observation_at(np.zeros(3), 1), depth=depth))
    points = obstacles.nearby_points(np.zeros(3))
    is_leg = np.abs(points[:, 1]) < 0.03
    assert np.allclose(points[is_leg, 0], 0.6, atol=0.01)
    assert np.allclose(points[~is_leg, 0], 1.2, atol=0.01)


def test_what_was_seen_before_is_remembered_where_it_was() -> None:
    obstacles = ObstacleMemory(LOCOBOT)
    obstacles.add(replace(observation_at(np.zeros(3), 1), depth=scene((1.0, 0.1, -0.1, 0.6))))
    passed = obstacles.nearby_points(np.array([1.4, 0.0, 0.0]))
    assert np.allclose(passed[:, 0], -0.4, atol=1e-6)
    assert collision_free_command(Twist(-0.5, 0.0), passed, 1.0, STRAIGHT, radius_m=RADIUS_M) is None
    turned = obstacles.nearby_points(np.array([1.0, 0.5, np.pi / 2]))
    assert np.isclose(turned[:, 0].mean(), -0.5, atol=0.02)


@pytest.mark.parametrize("count", [1, 100])
def test_what_is_seen_again_counts_once(count: int) -> None:
    obstacles = ObstacleMemory(LOCOBOT)
    image = replace(observation_at(np.zeros(3), 1), depth=scene((1.0, 0.1, -0.1, 0.6)))
    obstacles.add(replace(image, step=0))
    of_one = len(obstacles.nearby_points(np.zeros(3)))
    assert of_one > 0
    for k in range(count):
        obstacles.add(replace(image, step=k))
        obstacles.add(replace(image, step=k))
    assert len(obstacles.nearby_points(np.zeros(3))) == of_one


def test_what_the_robot_turned_away_from_a_whole_turn_ago_is_still_there() -> None:
    obstacles = ObstacleMemory(LOCOBOT)
    obstacles.add(replace(observation_at(np.zeros(3), 0), depth=scene((0.3, 0.05, -0.05, 0.6))))
    for k in range(1, 38):
        turned = np.array([0.0, 0.0, k * 2 * np.pi / 38])
        depth = np.where(scene() > 0, scene(), 0.0) * (abs(np.cos(turned[2])) < 0.5)  # What is ahead stays unseen.
        obstacles.add(replace(observation_at(turned, k), depth=depth.astype(np.float32)))
    here = obstacles.nearby_points(np.zeros(3))
    assert collision_free_command(AHEAD, here, 1.0, STRAIGHT, radius_m=RADIUS_M) is None


def test_what_has_gone_is_forgotten_as_soon_as_the_floor_behind_it_is_seen() -> None:
    obstacles = ObstacleMemory(LOCOBOT)
    obstacles.add(replace(observation_at(np.zeros(3), 0), depth=scene((0.3, 0.05, -0.05, 0.6))))
    there = obstacles.nearby_points(np.zeros(3))
    assert collision_free_command(AHEAD, there, 1.0, STRAIGHT, radius_m=RADIUS_M) is None
    obstacles.add(replace(observation_at(np.array([0.1, 0.0, 0.0]), 1), depth=scene()))
    assert len(obstacles.nearby_points(np.zeros(3))) == 0


def test_what_hangs_lower_than_the_robot_is_tall_stops_it() -> None:
    assert LOCOBOT.height_m == 0.8
    obstacles = ObstacleMemory(LOCOBOT)
    up = LENS.height_m + 0.3 * (36 - np.arange(72) - 0.5) / LENS.fx
    hangs = np.where((up > 0.7)[:, None], np.float32(0.3), np.zeros((72, 96), np.float32))
    obstacles.add(replace(observation_at(np.zeros(3), 0), depth=hangs))
    here = obstacles.nearby_points(np.zeros(3))
    assert collision_free_command(AHEAD, here, 1.0, STRAIGHT, radius_m=RADIUS_M) is None
    low = ObstacleMemory(replace(LOCOBOT, height_m=0.55))
    low.add(replace(observation_at(np.zeros(3), 0), depth=hangs))
    assert len(low.nearby_points(np.zeros(3))) == 0


def test_a_collision_that_no_image_showed_is_remembered_for_a_while() -> None:
    obstacles = ObstacleMemory(LOCOBOT)
    obstacles.add(observation_at(np.zeros(3), 1))
    obstacles.bump(np.zeros(3), backwards=False)
    here = obstacles.nearby_points(np.zeros(3))
    assert collision_free_command(AHEAD, here, 1.0, STRAIGHT, radius_m=RADIUS_M) is None
    assert collision_free_command(Twist(-0.5, 0.0), here, 1.0, STRAIGHT, radius_m=RADIUS_M) == Twist(-0.5, 0.0)
    obstacles.add(observation_at(np.zeros(3), 200))
    assert len(obstacles.nearby_points(np.zeros(3))) == 0


def test_through_a_narrow_gap_the_robot_goes_slowly() -> None:
    gap = np.array([[0.3, 0.21]] * 5 + [[0.3, -0.21]] * 5)
    through = collision_free_command(AHEAD, gap, 1.0, ROBUST.driving, radius_m=RADIUS_M)
    assert through is not None
    assert 0 < through.linear_m_s < 0.5 * AHEAD.linear_m_s
    assert through.angular_rad_s == 0


def test_what_an_image_of_a_map_shows_is_read_once_for_each_range() -> None:
    image = replace(observation_at(np.zeros(3), 0), depth=scene((0.9, 0.5, 0.3, 0.5)))
    for range_m in (1.5, 0.5):
        points = map_points(image, LENS, range_m, height_m=HEIGHT_M)
        assert np.array_equal(points, obstacle_points(image.depth, LENS, range_m, height_m=HEIGHT_M))
        assert map_points(image, LENS, range_m, height_m=HEIGHT_M) is points
        with pytest.raises(ValueError, match="read-only"):
            points[:] = 0.0
