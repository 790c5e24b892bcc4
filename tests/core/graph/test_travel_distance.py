"""Odometry rules out what it can and keeps silent about the rest."""

from dataclasses import replace

import numpy as np

from ltvn_core.config import PAPER, ROBUST
from ltvn_core.graph.matching import Matches
from ltvn_core.graph.odometry_gate import OdometryGate
from tests.core.flat_world import observation_at

ROW = [observation_at(np.array([0.25 * k, 0.0, 0.0]), 10 * k) for k in range(41)]  # Ten metres straight ahead.
TRAVEL = OdometryGate(ROW, ROBUST.building)


def match(node: int, x: float, yaw: float = 0.0) -> Matches:
    return Matches((node,), np.array([0.9]), np.array([[x, 0.0, yaw]]), np.array([x]), np.array([True]))


def test_only_what_could_be_near_is_worth_comparing() -> None:
    near = TRAVEL.may_be_near(0, [10, 40, 80, 200, 400])
    assert near == (10, 40)


def test_what_looks_the_other_way_is_not_worth_comparing() -> None:
    turning = [observation_at(np.array([0.0, 0.0, 0.2 * k]), k) for k in range(16)]
    assert OdometryGate(turning, ROBUST.building).may_be_near(0, [1, 4, 9, 15]) == (1, 4)


def test_a_waypoint_that_fits_what_was_driven_is_plausible() -> None:
    assert TRAVEL.plausible(0, match(40, 1.1)).all()
    assert not TRAVEL.plausible(0, match(400, 0.5)).any()
    assert not TRAVEL.plausible(0, match(40, 1.0, yaw=2.0)).any()


def test_after_a_long_way_round_more_is_allowed() -> None:
    way_round = [*ROW, *(observation_at(np.array([10.0 - 0.25 * k, 1.0, 0.0]), 1000 + 10 * k) for k in range(41))]
    odometry_gate = OdometryGate(way_round, ROBUST.building)
    assert odometry_gate.plausible(0, match(1400, 0.5)).all()  # 1 m beside the start, after 21 m.
    assert not TRAVEL.plausible(0, match(40, 2.2)).any()


def test_where_odometry_was_restarted_nothing_is_ruled_out() -> None:
    restarted = [*ROW, observation_at(np.array([50.0, 50.0, 3.0]), 5000)]
    odometry_gate = OdometryGate(restarted, ROBUST.building)
    assert odometry_gate.may_be_near(0, [5000, 400]) == (5000,)
    assert odometry_gate.plausible(0, match(5000, 0.5)).all()


def test_the_literal_method_does_not_ask_odometry() -> None:
    odometry_gate = OdometryGate(ROW, PAPER.building)
    assert odometry_gate.may_be_near(0, [10, 400]) == (10, 400)
    assert odometry_gate.plausible(0, match(400, 0.5)).all()
    off = replace(ROBUST.building, odometry_drift=0.0)
    assert OdometryGate(ROW[:1], off).may_be_near(0, []) == ()
