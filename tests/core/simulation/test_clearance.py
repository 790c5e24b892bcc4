"""Clearances are those of the floor, and ways through it can be driven."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from ltvn_core.simulation.clearance_map import PLANNING_CLEARANCE_M, ClearanceMap
from ltvn_core.simulation.scene_registry import load_scene
from tests.core.simulation.fake_scene import BoxScene

CELL_M = 0.05
LEFT_ROOM, RIGHT_ROOM = (1.0, 2.3), (5.0, 2.3)
"""On either side of the opening in the fake scene's inner wall."""


@pytest.fixture(scope="module")
def boxes() -> ClearanceMap:
    return BoxScene().clearance


@pytest.fixture(scope="module")
def apartment() -> ClearanceMap:
    return load_scene("train-00").clearance


def test_outside_the_map_there_is_no_clearance(apartment: ClearanceMap) -> None:
    assert (apartment.at([[-100.0, 0.0], [0.0, 100.0], [1e6, 1e6]]) == 0).all()


@pytest.mark.parametrize(
    ("place", "expected_m"), [((1.0, 2.3), 0.7), ((0.5, 0.5), 0.4), ((4.0, 2.5), 0.9), ((2.85, 2.3), 0.7)]
)
def test_clearance_is_the_distance_to_the_nearest_obstacle(
    boxes: ClearanceMap, place: tuple[float, float], expected_m: float
) -> None:
    assert boxes.at(place) == pytest.approx(expected_m, abs=CELL_M)


def test_clearance_keeps_the_shape_of_its_points(boxes: ClearanceMap) -> None:
    assert boxes.at((1.0, 2.3)).shape == ()
    assert boxes.at(np.ones((4, 3, 2))).shape == (4, 3)


def test_clearance_along_a_line_is_that_of_its_narrowest_place(boxes: ClearanceMap) -> None:
    through_the_wall, free = boxes.along([(1.0, 0.7), (1.0, 2.3)], [(4.0, 0.7), (2.0, 2.3)])
    assert through_the_wall == 0
    assert free == pytest.approx(0.7, abs=CELL_M)


@given(ends=st.lists(st.floats(0.1, 4.9), min_size=4, max_size=4))
def test_a_line_is_as_clear_one_way_as_the_other(boxes: ClearanceMap, ends: list[float]) -> None:
    start, end = np.array(ends[:2]), np.array(ends[2:])
    assert boxes.along(start, end) == pytest.approx(boxes.along(end, start), abs=1e-9)
    assert boxes.along(start, end) <= min(boxes.at(start), boxes.at(end)) + 1e-9


def test_a_path_goes_from_its_start_to_its_goal_over_navigable_floor(apartment: ClearanceMap) -> None:
    places = apartment.sample_poses(np.random.default_rng(1), 20)[:, :2]
    for start, goal in zip(places[:10], places[10:], strict=True):
        path = apartment.path(start, goal)
        assert path is not None
        assert np.array_equal(path[0], start)
        assert np.array_equal(path[-1], goal)
        gaps = np.sqrt((np.diff(path, axis=0) ** 2).sum(1))
        assert gaps.max() < 0.2
        # A step like a knight's may pass the corner of one cell that is too close.
        assert apartment.along(path[:-1], path[1:]).min() > PLANNING_CLEARANCE_M - CELL_M


def test_a_path_prefers_the_middle_of_an_opening(boxes: ClearanceMap) -> None:
    path = boxes.path((2.0, 1.9), (4.0, 1.9))
    assert path is not None
    at_the_wall = path[np.argmin(np.abs(path[:, 0] - 2.85))]
    assert boxes.at(at_the_wall) > 0.4


def test_there_is_no_path_into_a_wall_or_through_a_closed_one(boxes: ClearanceMap) -> None:
    assert boxes.path(LEFT_ROOM, (3.0, -5.0)) is None
    closed = boxes.blocked.copy()
    closed[:, 56:58] = True
    assert ClearanceMap(closed, boxes.origin).path(LEFT_ROOM, RIGHT_ROOM) is None


def test_a_way_is_at_least_as_long_as_the_straight_line(apartment: ClearanceMap) -> None:
    places = apartment.sample_poses(np.random.default_rng(2), 60)[:, :2]
    for start in places[:5]:
        straight = np.sqrt(((places - start) ** 2).sum(1))
        lengths = apartment.path_lengths(start, places)
        assert np.isfinite(lengths).all()
        assert (lengths >= straight - 1e-9).all()


def test_in_the_open_the_way_is_the_straight_line(boxes: ClearanceMap) -> None:
    assert boxes.path_lengths(LEFT_ROOM, [RIGHT_ROOM]) == pytest.approx(4.0)


def test_ways_beyond_the_limit_are_endless(boxes: ClearanceMap) -> None:
    lengths = boxes.path_lengths(LEFT_ROOM, [RIGHT_ROOM, (2.0, 2.3)], limit_m=2.0)
    assert lengths.tolist() == [np.inf, pytest.approx(1.0)]


@pytest.mark.parametrize("min_clearance_m", [0.22, 0.35])
def test_drawn_poses_are_clear_and_navigable(apartment: ClearanceMap, min_clearance_m: float) -> None:
    poses = apartment.sample_poses(np.random.default_rng(4), 500, min_clearance_m=min_clearance_m)
    assert poses.shape == (500, 3)
    assert apartment.at(poses[:, :2]).min() >= min_clearance_m
    assert (np.abs(poses[:, 2]) <= np.pi).all()
    assert np.isfinite(apartment.path_lengths(poses[0, :2], poses[:, :2])).all()


def test_the_same_seed_draws_the_same_poses(apartment: ClearanceMap) -> None:
    first, again, other = (apartment.sample_poses(np.random.default_rng(seed), 9) for seed in (5, 5, 6))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def test_no_pose_is_drawn_where_nothing_is_clear_enough() -> None:
    nowhere: NDArray[np.bool_] = np.ones((10, 10), bool)
    with pytest.raises(ValueError, match=r"clearance of 0\.22 m"):
        ClearanceMap(nowhere, np.zeros(2)).sample_poses(np.random.default_rng(0), 1)
