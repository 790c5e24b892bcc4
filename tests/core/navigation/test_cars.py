"""A car, which cannot turn on the spot, reaches its goal in the demo map on curves that its wheels can steer."""

from dataclasses import replace

import numpy as np
import pytest

from ltvn_core.maps.topological_map import TopologicalMap
from ltvn_core.navigation.events import Outcome, QueryEnded, Tick
from ltvn_core.robots.robot_spec import LOCOBOT, SpeedLimits
from ltvn_core.simulation.opening import open_simulation
from ltvn_core.types import CONTROL_STEP_S
from tests.repository import DEMO_MAP

RADIUS_M = 0.4
CAR = replace(LOCOBOT, name="car", speeds=SpeedLimits(turning_radius_m=RADIUS_M))


@pytest.mark.parametrize(("start", "goal"), [(56, 2694), (1681, 2196)])
def test_it_reaches_its_goal(start: int, goal: int) -> None:
    known = TopologicalMap.load(DEMO_MAP)
    began, wanted = (known.keyframes.observation(node).exact_pose for node in (start, goal))
    assert began is not None
    assert wanted is not None
    robot = open_simulation("demo", seed=0, start=began, spec=CAR, body="planar").robot
    outcome = None
    for event in known.navigator(robot).query(goal, 0):
        if isinstance(event, Tick):
            before = robot.exact_pose
            robot.clock.advance(CONTROL_STEP_S)
            moved = robot.exact_pose - before
            turned_rad = abs(np.remainder(moved[2] + np.pi, 2 * np.pi) - np.pi)
            # A chord is shorter than its arc, and contact may hold the body back, but not turn it faster.
            assert turned_rad * RADIUS_M <= 0.5 * CONTROL_STEP_S + 1e-6
            assert robot.speeds.angular_rad_s * RADIUS_M <= abs(robot.speeds.linear_m_s) + 1e-9
        elif isinstance(event, QueryEnded):
            outcome = event.outcome
    assert outcome is Outcome.ARRIVED
    assert np.hypot(*(robot.exact_pose - wanted)[:2]) < 0.6
