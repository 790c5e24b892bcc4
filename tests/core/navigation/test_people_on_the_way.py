"""The robot waits for people, keeps away from those it saw, and remembers them where its camera does not look."""

from dataclasses import replace

import numpy as np
import pytest

from ltvn_core.cameras.depth_points import are_solid, points_within, transform_points
from ltvn_core.cameras.depth_scan import DepthScan
from ltvn_core.navigation.bystanders import Bystanders
from ltvn_core.navigation.events import AttemptEnd
from ltvn_core.navigation.obstacle_memory import ObstacleMemory
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.types import Pose
from tests.core.flat_world import FlatWorld, box, observation_at, one_room
from tests.core.navigation.people_about import Attempts, depth_of

CORRIDOR = FlatWorld(np.array(box(6.0, 1.5)))
NOBODY_NEAR = (50.0, 50.0)


def stopped(attempts: Attempts) -> bool:
    return any(command.linear_m_s == 0 and command.angular_rad_s == 0 for command in attempts.commands)


def test_the_robot_lets_somebody_cross_and_drives_on() -> None:
    attempts = Attempts(one_room(), [0.6, 2.0, 0.0], lambda s: (2.0, min(0.3 + 0.8 * s, 3.7)))
    assert attempts.go(2.4).end is AttemptEnd.REACHED
    assert attempts.robot.nearest_m > 0.15
    assert stopped(attempts)


@pytest.mark.parametrize("width", [96, 48, 40, 24])
def test_who_walks_across_is_noticed_with_any_number_of_pixels(width: int) -> None:
    spec = replace(LOCOBOT, camera=LOCOBOT.camera.scaled(width, 3 * width // 4))
    memory = ObstacleMemory(spec, bystanders=Bystanders())
    pose = np.array([1.0, 2.0, 0.0])
    moved = list[bool]()
    for look in range(8):
        depth = depth_of(one_room().walls, np.array([2.0, 3.0 - 0.25 * look]), pose, spec.camera)
        memory.add(replace(observation_at(pose, look), depth=depth, stamp=0.3 * look))
        moved.append(memory.moves_ahead(pose))
    assert any(moved)


def test_the_robot_stops_before_somebody_who_comes_along_a_corridor() -> None:
    attempts = Attempts(CORRIDOR, [0.6, 0.75, 0.0], lambda s: (max(4.6 - 0.7 * s, 0.5), 0.75))
    attempts.go(2.4)
    assert stopped(attempts)
    assert attempts.robot.nearest_m > 0.15
    assert attempts.robot.collisions == 0


def test_the_robot_waits_where_somebody_fills_the_way_and_drives_on_when_they_have_gone() -> None:
    def walk(s: float) -> tuple[float, float]:
        return (max(3.4 - 0.7 * s, 2.2), 0.75) if s < 3.0 else (2.2 + 0.9 * (s - 3.0), 0.75)

    attempts = Attempts(CORRIDOR, [0.6, 0.75, 0.0], walk)
    assert attempts.go(1.6).end is AttemptEnd.REACHED
    assert attempts.robot.nearest_m > 0.15


def test_the_robot_goes_round_somebody_who_has_come_to_a_stand_with_distance() -> None:
    attempts = Attempts(one_room(), [0.6, 2.0, 0.0], lambda s: (2.2, min(1.0 + 0.8 * s, 1.85)))
    attempts.go(2.6)
    attempts.go(float(3.2 - attempts.robot.pose[0]))
    assert attempts.robot.pose[0] > 2.4
    assert attempts.robot.nearest_m > 0.08


def test_with_people_about_the_robot_turns_round_rather_than_back_into_who_comes_from_behind() -> None:
    def walk(s: float) -> tuple[float, float]:
        if s < 3.0:
            return 3.8, 0.8 + 1.2 * s  # Crosses before the robot, which sees it,
        return max(3.8 - 1.2 * (s - 3.0), 1.0), 3.4 if s < 6.0 else 2.0  # and is behind it then.

    attempts = Attempts(one_room(), [1.6, 2.0, 0.0], walk)
    attempts.go(0.9)
    for _ in range(25):
        attempts.robot.advance()
    attempts.go(-1.2)
    assert all(command.linear_m_s >= 0 for command in attempts.commands)
    assert attempts.robot.nearest_m > 0.1


def test_where_nobody_was_ever_seen_a_way_back_is_driven_backwards() -> None:
    attempts = Attempts(one_room(), [2.4, 2.0, 0.0], lambda s: NOBODY_NEAR)
    assert attempts.go(-1.0).end is AttemptEnd.REACHED
    assert all(command.linear_m_s <= 0 for command in attempts.commands)


def look(bystanders: Bystanders, person: tuple[float, float], pose: Pose, stamp: float, *, moved: bool = False) -> None:
    """Take in an image of the room with a person at a place; all that is seen of a person who `moved` has moved."""
    depth = depth_of(one_room().walls, np.array(person), pose)
    seen = points_within(depth, LOCOBOT.camera, 4.0)
    solid = are_solid(seen, LOCOBOT.clear_height_m)
    scan = DepthScan.of(LOCOBOT.camera, stamp, pose, seen, LOCOBOT.clear_height_m)
    points = transform_points(seen[solid, :2], pose)
    near = np.hypot(*(points - person).T) < 0.3
    bystanders.look(scan, points[near & moved])


def test_somebody_is_remembered_out_of_view_for_a_while_and_about_for_longer() -> None:
    bystanders, pose = Bystanders(), np.array([1.0, 2.0, 0.0])
    assert not bystanders.are_about(0.0)
    look(bystanders, (2.2, 2.0), pose, 1.0, moved=True)
    assert bystanders.near(1.0) == pytest.approx(np.array([[2.2, 2.0]]), abs=0.05)
    look(bystanders, (2.2, 2.0), np.array([1.0, 2.0, np.pi]), 2.0)
    assert len(bystanders.near(8.0)) == 1
    assert len(bystanders.near(60.0)) == 0
    assert bystanders.are_about(60.0)
    assert not bystanders.are_about(7200.0)


def test_who_stands_stays_known_and_who_has_gone_does_not() -> None:
    bystanders, pose = Bystanders(), np.array([1.0, 2.0, 0.0])
    look(bystanders, (2.2, 2.0), pose, 1.0, moved=True)
    look(bystanders, (2.3, 1.95), pose, 8.0)
    assert bystanders.near(15.0) == pytest.approx(np.array([[2.3, 1.95]]), abs=0.05)
    look(bystanders, NOBODY_NEAR, pose, 15.0)
    assert len(bystanders.near(15.0)) == 0
    assert bystanders.are_about(15.0)
