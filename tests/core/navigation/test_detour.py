"""One bend leads through what lies aslant, and none is found where there is no way."""

import numpy as np
import pytest

from ltvn_core.navigation.detour import find_detour
from ltvn_core.robots.robot_spec import LOCOBOT

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
