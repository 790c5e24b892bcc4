"""In a narrow way the robot drives through the middle; elsewhere it drives straight to its waypoint."""

import numpy as np
import pytest

from ltvn_core.config import ROBUST
from ltvn_core.geometry import compose, relative, rotation
from ltvn_core.navigation.steering import collision_free_command, drivable_aim, find_detour, steer
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.types import CONTROL_STEP_S

RADIUS_M = LOCOBOT.clear_radius_m


def corridor(half_width_m: float) -> np.ndarray:
    """Return points (M, 2) of two walls along x, from x = 0.5 to 2, which close the rest of the floor."""
    along = np.linspace(0.5, 2.0, 150)
    aside = np.linspace(half_width_m, 1.2, 60)
    sides = [np.stack([along, np.full(150, side * half_width_m)], axis=-1) for side in (1, -1)]
    front = [np.stack([np.full(60, 0.5), side * aside], axis=-1) for side in (1, -1)]
    return np.concatenate(sides + front)


@pytest.mark.parametrize("start_aside_m", [-0.12, -0.05, 0.0, 0.08])
@pytest.mark.parametrize("waypoint_aside_m", [-0.1, 0.0, 0.15])
def test_the_robot_drives_through_a_narrow_corridor_without_touching_it(
    start_aside_m: float, waypoint_aside_m: float
) -> None:
    walls = corridor(0.215)
    pose = np.array([0.0, start_aside_m, 0.2])
    waypoint = np.array([1.8, waypoint_aside_m, 0.0])
    nearest_m = np.inf
    for _ in range(200):
        points = (walls - pose[:2]) @ rotation(float(pose[2]))
        error = relative(pose, waypoint)
        place, is_narrow = drivable_aim(error[:2], points, radius_m=RADIUS_M)
        wish = steer(
            np.array([*place, error[2]]), ROBUST.driving, backwards=False, turn_first_rad=0.15 if is_narrow else 0.5
        )
        if wish is None:
            break
        twist = collision_free_command(
            wish, points, float(np.hypot(*place)), ROBUST.driving, radius_m=RADIUS_M, is_narrow=is_narrow
        )
        assert twist is not None, f"stuck at {pose}"
        pose = compose(pose, CONTROL_STEP_S * np.array([twist.linear_m_s, 0.0, twist.angular_rad_s]))
        nearest_m = min(nearest_m, float(np.hypot(*(walls - pose[:2]).T).min()))
    assert pose[0] > 1.6
    assert nearest_m > RADIUS_M


def test_on_an_open_floor_the_robot_drives_straight_to_its_waypoint() -> None:
    waypoint = np.array([1.5, 0.3])
    for points in (np.empty((0, 2)), np.array([[0.7, 0.8]] * 10), np.array([[-0.4, 0.0]] * 10)):
        place, is_narrow = drivable_aim(waypoint, points, radius_m=RADIUS_M)
        assert np.array_equal(place, waypoint)
        assert not is_narrow


def test_a_way_that_is_too_narrow_for_the_robot_is_left_to_detours() -> None:
    waypoint = np.array([1.5, 0.0])
    place, is_narrow = drivable_aim(waypoint, corridor(0.17), radius_m=RADIUS_M)
    assert place[1] == 0.0
    assert not is_narrow


def test_a_waypoint_in_a_wall_is_moved_to_the_free_floor_beside_it() -> None:
    wall = np.stack([np.linspace(-1.0, 2.0, 300), np.full(300, 0.3)], axis=-1)
    place, _ = drivable_aim(np.array([0.1, 0.25]), wall, radius_m=RADIUS_M)
    assert 0.3 - place[1] > RADIUS_M
    assert np.hypot(*(place - [0.1, 0.25])) < 0.25


GOAL = np.array([1.0, 0.0])
ROBOT_RADIUS_M = LOCOBOT.clear_radius_m


def wall(start: tuple[float, float], end: tuple[float, float]) -> np.ndarray:
    """Return points every centimetre."""
    length = float(np.hypot(end[0] - start[0], end[1] - start[1]))
    return np.linspace(start, end, int(length * 100) + 1)


def clearance(start: np.ndarray, end: np.ndarray, points: np.ndarray) -> float:
    way = np.linspace(start, end, 60)
    return float(np.linalg.norm(way[:, None] - points, axis=-1).min())


def test_round_the_end_of_a_wall_it_makes_a_detour() -> None:
    points = wall((0.5, -0.1), (0.5, 2.0))
    assert clearance(np.zeros(2), GOAL, points) < ROBOT_RADIUS_M
    place = find_detour(GOAL, points, radius_m=ROBOT_RADIUS_M)
    assert place is not None
    assert clearance(np.zeros(2), place, points) > ROBOT_RADIUS_M
    assert clearance(place, GOAL, points) > ROBOT_RADIUS_M - 0.02


def test_a_narrow_passage_is_entered_straight() -> None:
    # 0.46 m wide, along x; the robot stands aside of its axis.
    left, right = wall((0.4, 0.10), (2.0, 0.10)), wall((0.4, -0.36), (2.0, -0.36))
    points = np.concatenate([left, right])
    goal = np.array([1.2, -0.13])
    assert clearance(np.zeros(2), goal, points) < ROBOT_RADIUS_M
    place = find_detour(goal, points, radius_m=ROBOT_RADIUS_M)
    assert place is not None
    onward = goal - place
    assert abs(np.arctan2(onward[1], onward[0])) < 0.15


@pytest.mark.parametrize("gap_m", [0.0, 0.3])
def test_where_the_robot_does_not_fit_there_is_no_detour(gap_m: float) -> None:
    points = np.concatenate([wall((0.5, -2.0), (0.5, -gap_m / 2)), wall((0.5, gap_m / 2), (0.5, 2.0))])
    assert find_detour(GOAL, points, radius_m=ROBOT_RADIUS_M) is None


def test_where_nothing_stands_there_is_nothing_to_go_round() -> None:
    assert find_detour(GOAL, np.empty((0, 2)), radius_m=ROBOT_RADIUS_M) is None
