"""A drive that passes its places again is put right, however many of its loop closures are false."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from ltvn_core.geometry import compose, relative, wrap_angle
from ltvn_core.graph.pose_graph import RelativePoses, deviations, optimise
from ltvn_core.types import Pose

LAPS, CORNERS = 3, 4
STEP = np.array([1.0, 0.0, 0.0])
TURN = np.array([1.0, 0.0, np.pi / 2])


def square() -> Pose:
    """Return the poses of three rounds along a square of 8 m."""
    poses = [np.zeros(3)]
    for k in range(1, LAPS * CORNERS * 8 + 1):
        poses.append(compose(poses[-1], TURN if k % 8 == 0 else STEP))
    return np.array(poses)


def drifted(poses: Pose) -> Pose:
    """Return what a robot with a bias in its wheels would measure."""
    steps = relative(poses[:-1], poses[1:]) * np.array([1.03, 1.0, 1.0]) + np.array([0.0, 0.0, 0.01])
    measured = [poses[0]]
    for step in steps:
        measured.append(compose(measured[-1], step))
    return np.array(measured)


def measured(poses: Pose, first: np.ndarray, second: np.ndarray, deviation: float) -> RelativePoses:
    return RelativePoses(first, second, relative(poses[first], poses[second]), np.full((len(first), 3), deviation))


def in_a_row(poses: Pose) -> RelativePoses:
    rows = np.arange(len(poses) - 1)
    return measured(poses, rows, rows + 1, 0.04)


@pytest.mark.parametrize("false", [0, 30])
def test_true_closures_put_a_drive_right_and_false_ones_are_found_out(false: int) -> None:
    truth, odometry, rng = square(), drifted(square()), np.random.default_rng(0)
    lap = CORNERS * 8
    again = np.arange(lap, len(truth), 2)
    closures = measured(truth, again, again % lap, 0.1)
    wrong = rng.integers(len(truth), size=(false, 2))
    lies = RelativePoses(wrong[:, 0], wrong[:, 1], rng.normal(scale=0.4, size=(false, 3)), np.full((false, 3), 0.1))
    far = np.hypot(*relative(truth[wrong[:, 0]], truth[wrong[:, 1]])[:, :2].T) > 2.0
    both = RelativePoses(
        *(np.concatenate(pair) for pair in zip(_fields(closures), _fields(lies), strict=True))  # type: ignore[arg-type]
    )

    found = optimise(odometry, in_a_row(odometry), both)

    assert np.abs(odometry - truth)[:, :2].max() > 3.0
    assert np.abs(found.poses - truth)[:, :2].max() < 0.6
    assert found.kept[: len(again)].all()
    assert not found.kept[len(again) :][far].any()


def test_the_poses_are_those_of_exact_least_squares() -> None:
    truth, odometry = square(), drifted(square())
    again = np.arange(CORNERS * 8, len(truth), 2)
    chain, closures = in_a_row(odometry), measured(truth, again, again % (CORNERS * 8), 0.1)

    found = optimise(odometry, chain, closures)

    def errors(moved: np.ndarray) -> np.ndarray:
        poses = np.concatenate([odometry[:1], moved.reshape(-1, 3)])
        return np.concatenate([chain.errors(poses).ravel(), closures.errors(poses).ravel()])

    exact = least_squares(errors, truth[1:].ravel(), xtol=1e-12, ftol=1e-12)
    assert found.kept.all()
    gap = relative(exact.x.reshape(-1, 3), found.poses[1:])
    assert np.abs([*gap[:, :2].ravel(), *wrap_angle(gap[:, 2])]).max() < 1e-3


def test_closures_that_no_way_can_be_long_enough_for_bend_nothing() -> None:
    truth, odometry = square(), drifted(square())
    lap = CORNERS * 8
    again = np.arange(lap, len(truth), 2)
    true = measured(truth, again, again % lap, 0.1)
    absurd = RelativePoses(
        np.array([3, 20, 40]),
        np.array([50, 61, 90]),
        np.array([[700.0, 0, 0], [-90, 400, 1], [0, 300, 2]]),
        np.full((3, 3), 0.1),
    )
    both = RelativePoses(*(np.concatenate(pair) for pair in zip(_fields(true), _fields(absurd), strict=True)))  # type: ignore[arg-type]

    found = optimise(odometry, in_a_row(odometry), both)

    alone = optimise(odometry, in_a_row(odometry), true)
    assert np.allclose(found.poses, alone.poses)
    assert found.kept.tolist() == [True] * len(again) + [False] * 3


def test_without_closures_odometry_is_all_there_is() -> None:
    odometry = drifted(square())
    nothing = np.empty(0, np.intp)
    found = optimise(odometry, in_a_row(odometry), measured(odometry, nothing, nothing, 0.1))
    assert np.allclose(found.poses, odometry)
    assert found.kept.shape == (0,)


def test_a_place_is_as_unsure_as_a_drive_to_it_and_surer_once_it_is_recognised() -> None:
    truth = square()[: CORNERS * 8 + 1]
    odometry, nowhere = in_a_row(truth), np.empty(0, np.intp)
    without = deviations(truth, odometry, measured(truth, nowhere, nowhere, 0.1))
    back = measured(truth, np.array([0]), np.array([CORNERS * 8]), 0.1)
    closed = deviations(truth, odometry, back)
    again = np.arange(CORNERS * 8 + 1)
    often = measured(truth, again[:-10], again[10:], 0.1)
    off = replace(often, poses=often.poses + np.random.default_rng(0).normal(scale=0.1, size=often.poses.shape))
    assert (deviations(truth, odometry, often)[1:] < 1e-6).all()
    assert (deviations(truth, odometry, off)[1:] > 0.01).all()
    rng = np.random.default_rng(0)
    drives = [odometry.poses + rng.normal(scale=0.04, size=odometry.poses.shape) for _ in range(2000)]
    ends = np.zeros((2000, 3))
    for row in range(CORNERS * 8):
        ends = compose(ends, np.array([steps[row] for steps in drives]))
    spread = np.hypot(*ends[:, :2].std(axis=0)), ends[:, 2].std()
    assert without[-1] == pytest.approx(spread, rel=0.1)
    assert (closed[1:] < without[1:]).all()
    assert closed[-1, 0] == pytest.approx(np.hypot(0.1, 0.1), rel=0.1)


def test_many_closures_of_one_place_count_no_more_than_a_few_elsewhere() -> None:
    lap = CORNERS * 8
    truth, odometry = square(), drifted(square())
    true = np.array([lap + 3, lap + 11, lap + 19, lap + 27])
    mistaken = np.repeat([lap + 13, lap + 14], 10)
    first = np.concatenate([true, mistaken])
    second = np.concatenate([true - lap, mistaken - lap])
    poses = relative(truth[first], truth[second])
    poses[len(true) :, 0] += 3.0  # The next of a row of equal doors.
    shares = np.repeat([1.0, 3 / len(mistaken)], [len(true), len(mistaken)])
    closures = RelativePoses(first, second, poses, np.full((len(first), 3), 0.12), shares)

    kept = optimise(odometry, in_a_row(odometry), closures).kept

    assert kept[: len(true)].all()
    assert not kept[len(true) :].any()


def _fields(measured: RelativePoses) -> tuple[np.ndarray, ...]:
    return measured.first, measured.second, measured.poses, measured.deviations
