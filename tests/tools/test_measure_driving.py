"""Edges driven one by one: an oracle drives nearly all that exist, nobody drives through a wall."""

from contextlib import closing
from functools import lru_cache

import numpy as np
import pytest

pytest.importorskip("embreex")

from ltvn_core.config import ROBUST
from ltvn_core.evaluation.edge_driver import EdgeDriver, EdgeProposal
from ltvn_core.simulation.clearance_map import ClearanceMap
from ltvn_core.simulation.oracle_predictor import OraclePredictor
from ltvn_core.simulation.rendering.renderer_opening import open_renderer
from ltvn_core.simulation.scene_registry import Scene, load_scene
from ltvn_core.types import Pose
from tools.edge_proposals import predict_drive
from tools.measure_driving import SceneFigures, measure_scene, summarise_measurements

NO_ERRORS = np.zeros((1, 3))


def scene() -> Scene:
    return load_scene("tune-3")


def oracle() -> OraclePredictor:
    return OraclePredictor(scene().clearance)


def blind_oracle() -> OraclePredictor:
    """Knows every pose but no wall, so that it calls places behind walls reachable."""
    clearance = scene().clearance
    return OraclePredictor(ClearanceMap(np.zeros_like(clearance.blocked), clearance.origin))


@lru_cache
def measured() -> SceneFigures:
    steps: list[None] = []
    found = measure_scene(
        scene(),
        open_renderer(scene()),
        oracle(),
        ROBUST,
        attempts=12,
        images=70,
        rng=np.random.default_rng(1),
        progress=lambda: steps.append(None),
    )
    assert len(steps) == len(found.attempts)
    return found


@pytest.mark.slow
def test_an_oracle_drives_edges_that_exist_with_success() -> None:
    true = measured().attempts[measured().attempts["true"]]
    assert len(true) == 6
    assert np.mean(true["succeeded"]) >= 0.8
    assert np.mean(true["arrived"]) >= 0.8


def test_what_an_oracle_predicts_has_no_error() -> None:
    figures = summarise_measurements([measured()], "a command")
    assert figures.distance_sigma == pytest.approx(0, abs=1e-9)
    assert all(row.position_p90_m == pytest.approx(0, abs=1e-9) for row in figures.error_by_distance if row.pairs)
    assert sum(row.pairs for row in figures.calibration) == 70 * 69
    assert figures.success_if_reachable.trials == 6


def test_an_edge_through_a_wall_fails_however_sure_the_predictor_is() -> None:
    predictor = blind_oracle()
    poses = source_target_and_elsewhere()
    drive = predict_drive(scene(), open_renderer(scene()), predictor, poses)
    assert not drive.reachable[0, 1]
    assert drive.predicted.reachability[0, 1] > 0.9
    edge = EdgeProposal(0, 1, drive.waypoints[0, 1], 0.97, true=False, connected=True)
    with closing(EdgeDriver(drive.imaged_scene, predictor, ROBUST, NO_ERRORS, np.random.default_rng(0))) as robot:
        attempt = robot.drive(edge)
    assert attempt is not None
    assert not attempt.succeeded
    assert not attempt.arrived


def source_target_and_elsewhere() -> Pose:
    """Return (3, 3): a pose, one that it looks at through a wall, well behind it, and one far away."""
    clearance = scene().clearance
    poses = clearance.sample_poses(np.random.default_rng(0), 300, min_clearance_m=0.3)
    for source in poses:
        gap = poses[:, :2] - source[:2]
        away = np.hypot(*gap.T)
        near = np.flatnonzero((away > 1.6) & (away < 2.3) & (clearance.at(poses[:, :2]) > 0.7))
        for target in near[np.isinf(clearance.path_lengths(source[:2], poses[near, :2], limit_m=4.0))]:
            yaw = np.arctan2(*gap[target][::-1])
            places = np.array([source[:2], poses[target, :2], poses[away.argmax(), :2]])
            return np.column_stack([places, np.full(3, yaw)])
    raise AssertionError("the scene has no such wall")
