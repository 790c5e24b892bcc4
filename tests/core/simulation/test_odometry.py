"""Odometry errs as wheels do: by a share of the way, drawn from a seed, and not at all when asked so."""

import math
from collections.abc import Iterable

import numpy as np
import pytest

from ltvn_core.simulation.wheel_odometry import Odometer, OdometryNoise
from ltvn_core.types import Pose

START = np.array([1.0, -2.0, 0.5])
Motion = tuple[float, float, float]


def test_without_noise_odometry_is_exact() -> None:
    odometer = Odometer(START, OdometryNoise.NONE, np.random.default_rng(0))
    # A square of 2 m, driven counter-clockwise, ends where it began.
    for _ in range(4):
        _move(odometer, [(0.01, 0.0, 0.0)] * 200)
        _move(odometer, [(0.0, 0.0, math.pi / 200)] * 100)
    assert odometer.pose == pytest.approx(START, abs=1e-9)


def test_forward_is_along_the_heading_and_left_is_left_of_it() -> None:
    odometer = Odometer(np.array([0.0, 0.0, math.pi / 2]), OdometryNoise.NONE, np.random.default_rng(0))
    odometer.move(1.0, 0.25, 0.0)
    assert odometer.pose == pytest.approx([-0.25, 1.0, math.pi / 2])


def test_a_robot_that_stands_does_not_drift() -> None:
    odometer = Odometer(START, OdometryNoise(), np.random.default_rng(0))
    _move(odometer, [(0.0, 0.0, 0.0)] * 1000)
    assert np.array_equal(odometer.pose, START)


def test_the_same_seed_errs_in_the_same_way() -> None:
    first, again, other = (_pose_after(20.0, seed) for seed in (1, 1, 2))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def test_the_error_grows_with_the_distance() -> None:
    near, middle, far = (_typical_error_m(length_m) for length_m in (1.0, 5.0, 25.0))
    assert 0 < near < middle < far
    assert near == pytest.approx(0.02, rel=0.5)
    assert far < 5.0


def test_wheels_that_slip_jump_now_and_then_and_else_err_as_before() -> None:
    jumps = {slips: sum(_jumps(OdometryNoise(slips=slips), seed) for seed in range(20)) for slips in (0.0, 0.2)}
    # 200 sections of a metre, of which a fifth slips; a tenth of the slips is too small to be counted.
    assert jumps[0.0] == 0
    assert 24 <= jumps[0.2] <= 48


def test_how_a_motion_is_cut_into_pieces_hardly_matters() -> None:
    coarse, fine = (_pose_after(10.0, 3, step_m=step_m) for step_m in (0.004, 0.001))
    assert coarse == pytest.approx(fine, abs=0.02)


def test_errors_have_no_preferred_direction() -> None:
    errors = np.array([_pose_after(5.0, seed) - [5.0, 0.0, 0.0] for seed in range(300)])
    assert np.abs(errors.mean(0)).max() < 4 * errors.std(0).max() / np.sqrt(300)


def test_restarting_forgets_the_drift() -> None:
    odometer = Odometer(START, OdometryNoise(), np.random.default_rng(0))
    _move(odometer, [(0.01, 0.0, 0.001)] * 1000)
    odometer.restart(START)
    assert np.array_equal(odometer.pose, START)


def _move(odometer: Odometer, motions: Iterable[Motion]) -> None:
    for motion in motions:
        odometer.move(*motion)


def _pose_after(length_m: float, seed: int, *, step_m: float = 0.05) -> Pose:
    """Return where odometry believes to be after a straight drive from the origin."""
    odometer = Odometer(np.zeros(3), OdometryNoise(), np.random.default_rng(seed))
    _move(odometer, [(step_m, 0.0, 0.0)] * round(length_m / step_m))
    return odometer.pose


def _jumps(noise: OdometryNoise, seed: int) -> int:
    """Count the steps of a straight drive of ten metres in which odometry turned by more than 0.01 rad."""
    odometer = Odometer(np.zeros(3), noise, np.random.default_rng(seed))
    poses = [odometer.pose]
    for _ in range(2000):
        odometer.move(0.005, 0.0, 0.0)
        poses.append(odometer.pose)
    return int((np.abs(np.diff(np.array(poses)[:, 2])) > 0.01).sum())


def _typical_error_m(length_m: float) -> float:
    errors = [_pose_after(length_m, seed)[:2] - [length_m, 0.0] for seed in range(60)]
    return float(np.sqrt((np.array(errors) ** 2).sum(1).mean()))
