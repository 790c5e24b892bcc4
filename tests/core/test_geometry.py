"""SE(2) obeys its axioms, and the closed-form distance is the matrix logarithm's."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import logm

from ltvn_core.geometry import (
    compose,
    distance,
    invert,
    lengths_along,
    points_along,
    relative,
    rotation,
    wrap_angle,
)

metres = st.floats(-20, 20, allow_subnormal=False)
angles = st.floats(-3.1, 3.1, allow_subnormal=False)
poses = st.builds(lambda x, y, yaw: np.array([x, y, yaw]), metres, metres, angles)


def same(first: np.ndarray, second: np.ndarray) -> bool:
    gap = np.asarray(first) - np.asarray(second)
    return bool(np.allclose(gap[..., :2], 0, atol=1e-8) and np.allclose(wrap_angle(gap[..., 2]), 0, atol=1e-8))


def matrix(pose: np.ndarray) -> np.ndarray:
    transform = np.eye(3)
    transform[:2, :2], transform[:2, 2] = rotation(pose[2]), pose[:2]
    return transform


@given(poses, poses, poses)
def test_composition_is_associative(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> None:
    assert same(compose(compose(a, b), c), compose(a, compose(b, c)))


@given(poses)
def test_the_inverse_undoes_a_waypoint_from_both_sides(a: np.ndarray) -> None:
    assert same(compose(a, invert(a)), np.zeros(3))
    assert same(compose(invert(a), a), np.zeros(3))


@given(poses)
def test_standing_still_changes_nothing(a: np.ndarray) -> None:
    assert same(compose(a, np.zeros(3)), a)
    assert same(compose(np.zeros(3), a), a)


@given(poses, poses)
def test_composition_is_the_product_of_the_matrices(a: np.ndarray, b: np.ndarray) -> None:
    assert np.allclose(matrix(compose(a, b)), matrix(a) @ matrix(b), atol=1e-9)


@given(poses, poses)
def test_a_relative_pose_leads_from_source_to_target(a: np.ndarray, b: np.ndarray) -> None:
    assert same(compose(a, relative(a, b)), b)


@given(poses, poses, poses)
def test_relative_poses_do_not_depend_on_the_world_frame(frame: np.ndarray, a: np.ndarray, b: np.ndarray) -> None:
    assert same(relative(compose(frame, a), compose(frame, b)), relative(a, b))


@given(poses)
def test_the_distance_is_the_norm_of_the_matrix_logarithm(a: np.ndarray) -> None:
    assert distance(a) == pytest.approx(np.linalg.norm(logm(matrix(a))), abs=1e-6, rel=1e-6)


def test_a_metre_ahead_is_one_and_a_radian_on_the_spot_is_root_two() -> None:
    assert distance(np.array([1.0, 0, 0])) == pytest.approx(1)
    assert distance(np.array([0, 0, 1.0])) == pytest.approx(np.sqrt(2))


@given(st.floats(-50, 50))
def test_wrapped_angles_lie_in_the_half_open_circle(angle: float) -> None:
    wrapped = float(wrap_angle(angle))
    assert -np.pi < wrapped <= np.pi
    assert np.isclose(np.cos(wrapped), np.cos(angle), atol=1e-9)


def test_pi_stays_pi() -> None:
    assert wrap_angle(np.pi) == np.pi
    assert wrap_angle(-np.pi) == np.pi


def test_batches_give_what_single_poses_give() -> None:
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(5, 3)), rng.normal(size=(5, 3))
    assert np.allclose(compose(a, b), [compose(x, y) for x, y in zip(a, b, strict=True)])
    assert np.allclose(relative(a[0], b), [relative(a[0], y) for y in b])
    assert np.allclose(distance(a), [distance(x) for x in a])


@given(poses, poses)
def test_one_pose_gives_the_very_numbers_of_many(a: np.ndarray, b: np.ndarray) -> None:
    many = np.tile(a, (2, 1)), np.tile(b, (2, 1))
    assert all(np.array_equal(row, compose(a, b)) for row in compose(*many))
    assert all(np.array_equal(row, relative(a, b)) for row in relative(*many))
    assert all(np.array_equal(row, invert(a)) for row in invert(many[0]))
    assert all(np.array_equal(row, compose(a, b)) for row in (*compose(a, many[1]), *compose(many[0], b)))


def test_points_along_a_path_lie_at_their_lengths_and_stay_on_it() -> None:
    corner = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0]])
    assert lengths_along(corner).tolist() == [0, 2, 3]
    assert points_along(corner, np.array([0.5, 2.5, 9.0])).tolist() == [[0.5, 0], [2, 0.5], [2, 1]]
