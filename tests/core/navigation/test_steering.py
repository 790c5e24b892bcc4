"""The controller gets there, forwards or backwards, within the limits and without dithering."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ltvn_core.config import ROBUST
from ltvn_core.geometry import compose, relative
from ltvn_core.maps.topological_map import TopologicalMap
from ltvn_core.navigation.events import Outcome, QueryEnded, Tick
from ltvn_core.navigation.steering import REACHED_RAD, TURN_RAD_S, TurningCircle, drives_backwards, steer
from ltvn_core.robots.robot_spec import LOCOBOT, SpeedLimits
from ltvn_core.simulation.opening import open_simulation
from ltvn_core.types import CONTROL_STEP_S, Twist, Waypoint
from tests.repository import DEMO_MAP

DRIVING = ROBUST.driving
waypoints = st.builds(
    lambda x, y, yaw: np.array([x, y, yaw]), st.floats(-1.5, 1.5), st.floats(-1.0, 1.0), st.floats(-1.2, 1.2)
)


def driven(waypoint: Waypoint, steps: int = 300) -> tuple[Waypoint, list[float]]:
    """Return what is left after driving, and the speeds on the way."""
    pose, backwards, speeds = np.zeros(3), drives_backwards(waypoint), []
    for _ in range(steps):
        twist = steer(relative(pose, waypoint), DRIVING, backwards=backwards)
        if twist is None:
            return relative(pose, waypoint), speeds
        assert abs(twist.linear_m_s) <= DRIVING.speed_m_s + 1e-9
        assert abs(twist.angular_rad_s) <= TURN_RAD_S + 1e-9
        pose = compose(pose, np.array([twist.linear_m_s * 0.1, 0.0, twist.angular_rad_s * 0.1]))
        speeds.append(twist.linear_m_s)
    raise AssertionError(f"never reached {waypoint}")


@settings(max_examples=100)
@given(waypoints)
def test_every_waypoint_is_reached(waypoint: Waypoint) -> None:
    left, _ = driven(waypoint)
    assert np.hypot(left[0], left[1]) < 0.2
    assert abs(left[2]) < REACHED_RAD


@settings(max_examples=100)
@given(waypoints)
def test_an_attempt_is_driven_either_forwards_or_backwards(waypoint: Waypoint) -> None:
    _, speeds = driven(waypoint)
    assert min(speeds, default=0.0) >= 0 or max(speeds) <= 0


def test_what_lies_behind_is_reached_backwards() -> None:
    _, speeds = driven(np.array([-1.0, 0.0, 0.0]))
    assert min(speeds) < -0.3


def test_the_robot_turns_before_it_drives_aside() -> None:
    twist = steer(np.array([0.1, 1.0, 0.0]), DRIVING, backwards=False)
    assert twist is not None
    assert twist.linear_m_s == 0
    assert twist.angular_rad_s > 0


def test_where_the_robot_is_already_there_is_nothing_to_drive() -> None:
    assert steer(np.array([0.02, 0.01, 0.01]), DRIVING, backwards=False) is None


@pytest.mark.parametrize("yaw", [0.8, -0.8])
def test_a_turn_on_the_spot_drives_nowhere(yaw: float) -> None:
    _, speeds = driven(np.array([0.0, 0.0, yaw]))
    assert set(speeds) == {0.0}


CAR = SpeedLimits(turning_radius_m=0.4)


@settings(max_examples=100)
@given(waypoints)
def test_a_car_reaches_every_waypoint_on_curves_that_it_can_steer(waypoint: Waypoint) -> None:
    circle, pose, backwards = TurningCircle(CAR), np.zeros(3), drives_backwards(waypoint)
    for _ in range(circle.legs * 100):
        wish = circle.steer(relative(pose, waypoint), DRIVING, backwards=backwards)
        if wish is None:
            break
        twist = next(circle.commands(wish, pose))
        assert abs(twist.angular_rad_s) * CAR.turning_radius_m <= abs(twist.linear_m_s) + 1e-9
        pose = compose(pose, np.array([twist.linear_m_s * 0.1, 0.0, twist.angular_rad_s * 0.1]))
    left = relative(pose, waypoint)
    assert np.hypot(left[0], left[1]) < 0.4
    assert abs(left[2]) < REACHED_RAD


def test_a_car_that_may_not_drive_on_turns_with_the_other_arc() -> None:
    circle = TurningCircle(CAR)
    first, second = circle.commands(Twist(0.0, 1.0), np.zeros(3))
    assert first.linear_m_s * second.linear_m_s < 0
    assert first.angular_rad_s > 0
    assert second.angular_rad_s > 0


def test_a_base_that_turns_on_the_spot_drives_what_it_is_told() -> None:
    assert list(TurningCircle(SpeedLimits()).commands(Twist(0.0, 1.0), np.zeros(3))) == [Twist(0.0, 1.0)]


RADIUS_M = 0.4
CAR_ROBOT = replace(LOCOBOT, name="car", speeds=SpeedLimits(turning_radius_m=RADIUS_M))


@pytest.mark.parametrize(("start", "goal"), [(56, 2694), (1681, 2196)])
def test_it_reaches_its_goal(start: int, goal: int) -> None:
    known = TopologicalMap.load(DEMO_MAP)
    began, wanted = (known.keyframes.observation(node).exact_pose for node in (start, goal))
    assert began is not None
    assert wanted is not None
    robot = open_simulation("demo", seed=0, start=began, spec=CAR_ROBOT, body="planar").robot
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
