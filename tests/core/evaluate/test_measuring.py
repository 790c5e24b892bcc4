"""Edges driven one by one: an oracle drives nearly all that exist, nobody drives through a wall."""

from contextlib import closing
from functools import lru_cache

import numpy as np
import pytest

pytest.importorskip("embreex")
pytest.importorskip("pybullet")

from ltvn_core.config import ROBUST
from ltvn_core.evaluate.attempts import Attempts
from ltvn_core.evaluate.measuring import SceneMeasured, measure_scene, summarise
from ltvn_core.evaluate.proposals import Proposal
from ltvn_core.evaluate.survey import Survey, survey
from ltvn_core.sim.camera import open_camera
from ltvn_core.sim.clearance import ClearanceMap
from ltvn_core.sim.oracle import OraclePredictor
from ltvn_core.sim.scenes import Scene, load_scene

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
def measured() -> SceneMeasured:
    steps: list[None] = []
    found = measure_scene(
        scene(),
        open_camera(scene()),
        oracle(),
        ROBUST,
        attempts=12,
        images=70,
        rng=np.random.default_rng(1),
        progress=lambda: steps.append(None),
    )
    assert len(steps) == len(found.attempted)
    return found


def test_an_oracle_drives_edges_that_exist_with_success() -> None:
    true = [each for each in measured().attempted if each.edge.true]
    assert len(true) == 6
    assert np.mean([each.succeeded for each in true]) >= 0.8
    assert np.mean([each.arrived for each in true]) >= 0.8


def test_what_an_oracle_predicts_has_no_error() -> None:
    figures = summarise([measured()], "ltvn measure")
    assert figures.distance_sigma == pytest.approx(0, abs=1e-9)
    assert all(row.position_p90_m == pytest.approx(0, abs=1e-9) for row in figures.error_by_distance if row.pairs)
    assert sum(row.pairs for row in figures.calibration) == 70 * 69
    assert figures.success_if_reachable.trials == 6


def test_an_edge_through_a_wall_fails_however_sure_the_predictor_is() -> None:
    predictor = blind_oracle()
    drive = survey(scene(), open_camera(scene()), predictor, images=120, rng=np.random.default_rng(3))
    edges = through_walls(drive)[:3]
    assert edges
    with closing(Attempts(drive, predictor, ROBUST, NO_ERRORS, np.random.default_rng(0))) as robot:
        attempts = [done for edge in edges if (done := robot.drive(edge)) is not None]
    assert attempts
    assert not any(each.succeeded or each.arrived for each in attempts)


def through_walls(drive: Survey) -> list[Proposal]:
    """Return edges ahead, 1 to 2 m long, whose straight line meets a wall."""
    away = np.hypot(drive.waypoints[..., 0], drive.waypoints[..., 1])
    bearing = np.abs(np.arctan2(drive.waypoints[..., 1], drive.waypoints[..., 0]))
    ahead = (away > 1.0) & (away < 2.0) & (bearing < 0.5) & (np.abs(drive.waypoints[..., 2]) < 0.9)
    pairs = [
        (i, j)
        for i, j in np.argwhere(ahead).tolist()
        if scene().clearance.along(drive.poses[[i], :2], drive.poses[[j], :2])[0] <= 0
    ]
    return [Proposal(i, j, drive.waypoints[i, j], 0.97, true=False, connected=True) for i, j in pairs[::5]]
