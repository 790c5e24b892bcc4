"""The oracle answers by the paper's criteria, from what is true in the scene."""

import numpy as np
import pytest

from ltvn_core.geometry import relative
from ltvn_core.simulation.clearance_map import ClearanceMap
from ltvn_core.simulation.oracle_predictor import (
    MAX_DISTANCE_M,
    REACHABLE,
    UNREACHABLE,
    OraclePredictor,
    is_drivable,
    is_line_free,
)
from ltvn_core.types import Observation, Pose
from tests.core.simulation.fake_scene import BoxScene

HERE = np.array([0.5, 2.3, 0.0])
"""Looks along x through the opening of the inner wall at x = 2.8 to 2.9 m, y = 1.6 to 3.0 m."""


@pytest.fixture(scope="module")
def clearance() -> ClearanceMap:
    return BoxScene().clearance


@pytest.fixture(scope="module")
def oracle(clearance: ClearanceMap) -> OraclePredictor:
    return OraclePredictor(clearance)


@pytest.mark.parametrize(
    "target",
    [
        pytest.param((1.5, 2.3, 0.0), id="ahead"),
        pytest.param((2.9, 2.3, 0.0), id="as far as can be"),
        pytest.param((1.5, 2.7, 0.9), id="turned a little"),
        pytest.param((0.3, 2.3, 0.0), id="just behind"),
        pytest.param((0.5, 2.5, 0.3), id="beside"),
        pytest.param((0.5, 2.3, 0.0), id="here"),
    ],
)
def test_a_target_nearby_in_view_is_reachable(oracle: OraclePredictor, target: tuple[float, float, float]) -> None:
    assert _reachability(oracle, HERE, np.array(target)) == REACHABLE


@pytest.mark.parametrize(
    ("source", "target"),
    [
        pytest.param((2.0, 2.3, 0.0), (1.0, 2.3, 0.0), id="behind"),
        pytest.param((0.5, 2.3, 0.0), (3.1, 2.3, 0.0), id="too far"),
        pytest.param((0.5, 2.3, 0.0), (1.5, 2.3, 1.2), id="turned too far"),
        pytest.param((2.3, 1.0, 0.0), (3.5, 1.0, 0.0), id="through a wall"),
        pytest.param((2.0, 2.3, 0.0), (2.4, 2.9, 0.0), id="out of view"),
        pytest.param((2.0, 1.7, 0.0), (3.6, 1.7, 0.0), id="past a corner that is too near"),
        pytest.param((2.0, 2.3, 0.0), (2.0, 2.3, 3.0), id="here, facing away"),
    ],
)
def test_a_target_that_breaks_a_criterion_is_not(
    oracle: OraclePredictor, source: tuple[float, float, float], target: tuple[float, float, float]
) -> None:
    assert _reachability(oracle, np.array(source), np.array(target)) == UNREACHABLE


def test_the_limit_of_distance_is_sharp(oracle: OraclePredictor) -> None:
    near, far = (np.add(HERE, (MAX_DISTANCE_M + off, 0.0, 0.0)) for off in (-0.01, 0.01))
    assert _reachability(oracle, HERE, near) == REACHABLE
    assert _reachability(oracle, HERE, far) == UNREACHABLE


def test_waypoints_are_exact_whether_reachable_or_not(oracle: OraclePredictor, clearance: ClearanceMap) -> None:
    poses = clearance.sample_poses(np.random.default_rng(0), 40)
    sources, targets = (oracle.encode([_seen(pose) for pose in half]) for half in (poses[:20], poses[20:]))
    prediction = oracle.predict(sources, targets)
    assert prediction.waypoints == pytest.approx(relative(poses[:20], poses[20:]))
    assert prediction.reachability.shape == (20,)


def test_one_source_meets_all_targets(oracle: OraclePredictor, clearance: ClearanceMap) -> None:
    poses = clearance.sample_poses(np.random.default_rng(1), 30)
    together = oracle.predict(HERE[None], poses)
    apart = [oracle.predict(HERE[None], pose[None]) for pose in poses]
    assert together.reachability.tolist() == [float(prediction.reachability[0]) for prediction in apart]
    assert set(together.reachability.tolist()) == {REACHABLE, UNREACHABLE}


def test_no_targets_give_no_answers(oracle: OraclePredictor) -> None:
    prediction = oracle.predict(HERE[None], oracle.encode([]))
    assert prediction.reachability.shape == (0,)
    assert prediction.waypoints.shape == (0, 3)


def test_an_image_without_an_exact_pose_is_refused(oracle: OraclePredictor) -> None:
    with pytest.raises(ValueError, match="image 7 has none"):
        oracle.encode([_seen(HERE), _seen(None, step=7)])


@pytest.mark.parametrize(
    ("target", "drivable"),
    [
        ((3.2, 2.3, 0.0), True),  # Farther than the oracle's limit, within the tolerance.
        ((3.5, 2.3, 0.0), False),
        ((1.5, 2.3, 1.5), True),
        ((1.5, 2.3, 1.7), False),
        ((3.3, 1.0, 0.0), False),
    ],
)
def test_an_edge_is_spurious_if_a_robot_could_not_drive_it(
    clearance: ClearanceMap, target: tuple[float, float, float], drivable: bool
) -> None:
    assert is_drivable(clearance, HERE, np.array(target)).tolist() == [drivable]


def test_lines_of_nothing_are_no_lines(clearance: ClearanceMap) -> None:
    assert is_line_free(clearance, np.empty((0, 3)), np.empty((0, 3))).shape == (0,)


def _reachability(oracle: OraclePredictor, source: Pose, target: Pose) -> float:
    return float(oracle.predict(oracle.encode([_seen(source)]), oracle.encode([_seen(target)])).reachability[0])


def _seen(exact_pose: Pose | None, *, step: int = 0) -> Observation:
    rgb, depth = np.zeros((72, 96, 3), np.uint8), np.zeros((72, 96), np.float32)
    return Observation(rgb, depth, np.zeros(3), 0.0, step, exact_pose)
