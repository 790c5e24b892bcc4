"""A leg finds another way before it says that it is blocked."""

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from ltvn_core.config import ROBUST
from ltvn_core.graph.keyframes import KeyframeStore
from ltvn_core.graph.matching import Matcher
from ltvn_core.navigation.attempt_driver import AttemptDriver, AttemptResult
from ltvn_core.navigation.events import AttemptEnd
from ltvn_core.navigation.perception import MotionExecutor, Perception
from ltvn_core.robots.robot_spec import LOCOBOT
from ltvn_core.types import NodeId, Pose, Twist, Waypoint
from tests.core.flat_world import FlatPredictor, FlatRobot, FlatWorld, box, observation_at, one_room

NODE, OTHER = 0, 1


class Drive:
    """A robot in a room, which drives legs to one node."""

    def __init__(self, world: FlatWorld, start: list[float], node: list[float], *, node_depth_m: float = 5.0) -> None:
        predictor = FlatPredictor(world)
        keyframes = KeyframeStore(predictor)
        image = observation_at(np.array(node), NODE)
        keyframes.add([replace(image, depth=np.full_like(image.depth, node_depth_m))])
        keyframes.add([replace(image, step=OTHER, depth=np.full_like(image.depth, 1.0))])
        self.robot = FlatRobot(world, start, first_step=100)
        motion = MotionExecutor(self.robot, 0, ROBUST.recovering)
        perception = Perception(motion, predictor, Matcher(predictor, keyframes, ROBUST.matching))
        self._attempt_driver = AttemptDriver(motion, perception, ROBUST.driving, LOCOBOT)
        self.commands: list[Twist] = []
        self.places: list[Pose] = []

    def go(
        self, waypoint: Waypoint, *, is_known: bool = False, around: Mapping[NodeId, Pose] | None = None
    ) -> AttemptResult:
        """Let time pass until the leg ends."""
        self.commands, self.places = [], []
        steps: Iterator[object] = iter(self._steps(waypoint, is_known=is_known, around=around or {}))
        for _ in steps:
            self.robot.advance()
            self.commands.append(self.robot.twist)
            self.places.append(self.robot.pose)
        return self._result

    def _steps(self, waypoint: Waypoint, *, is_known: bool, around: Mapping[NodeId, Pose]) -> Iterator[object]:
        self._result = yield from self._attempt_driver.drive(NODE, waypoint, is_known=is_known, around=around)


def test_where_backing_up_touched_something_the_robot_turns_round_and_drives_on_looking() -> None:
    behind = FlatWorld(np.array([*box(5.0, 4.0), [[1.7, 0.5], [1.7, 1.5]]]))
    drive = Drive(behind, [2.0, 1.0, 0.0], [1.5, 1.0, 0.0])
    waypoint = np.array([-0.5, 0.0, 0.0])
    assert drive.go(waypoint).end is AttemptEnd.COLLISION
    drive.robot.world = one_room()  # What stood there is gone.
    left = np.array([1.5, 1.0, 0.0]) - drive.robot.pose
    assert drive.go(left).end is AttemptEnd.REACHED
    assert np.allclose(drive.robot.pose, [1.5, 1.0, 0.0], atol=0.1)
    assert any(command.linear_m_s > 0 for command in drive.commands)
    assert drive.robot.collisions == 1


def test_a_way_back_that_is_wide_is_driven_backwards() -> None:
    drive = Drive(one_room(), [2.0, 1.0, 0.0], [1.0, 1.0, 0.0])
    assert drive.go(np.array([-1.0, 0.0, 0.0])).end is AttemptEnd.REACHED
    assert all(command.linear_m_s <= 0 for command in drive.commands)


def test_what_other_images_of_the_map_show_behind_the_robot_is_not_backed_into() -> None:
    drive = Drive(one_room(), [2.0, 1.0, 0.0], [1.0, 1.0, 0.0])
    wall_m = 1.3
    around = {OTHER: np.array([wall_m - 1.0 - 2.0, 0.0, 0.0])}
    assert drive.go(np.array([-1.0, 0.0, 0.0]), around=around).end is AttemptEnd.REACHED
    back = [place[0] for place, each in zip(drive.places, drive.commands, strict=True) if each.linear_m_s < 0]
    assert wall_m + LOCOBOT.radius_m < min(back) < 2.0
    assert any(command.linear_m_s > 0 for command in drive.commands)


def test_a_long_way_back_is_driven_looking() -> None:
    drive = Drive(one_room(), [3.5, 1.0, 0.0], [1.5, 1.0, 0.0])
    assert drive.go(np.array([-2.0, 0.0, 0.0]), is_known=True).end is AttemptEnd.REACHED
    assert all(command.linear_m_s >= 0 for command in drive.commands)
    assert np.allclose(drive.robot.pose, [1.5, 1.0, 0.0], atol=0.1)


def test_where_the_drive_saw_that_the_way_back_is_narrow_the_robot_drives_it_looking() -> None:
    drive = Drive(one_room(), [2.0, 1.0, 0.0], [1.0, 1.0, 0.0], node_depth_m=0.6)
    assert drive.go(np.array([-1.0, 0.0, 0.0])).end is AttemptEnd.REACHED
    assert all(command.linear_m_s >= 0 for command in drive.commands)
    assert np.allclose(drive.robot.pose, [1.0, 1.0, 0.0], atol=0.1)


def test_a_far_place_that_the_map_knows_is_driven_to_at_once() -> None:
    far = FlatWorld(np.array(box(9.0, 4.0)))
    waypoint = np.array([7.0, 0.0, 0.0])
    known, predicted = (Drive(far, [1.0, 1.0, 0.0], [8.0, 1.0, 0.0]) for _ in range(2))
    assert known.go(waypoint, is_known=True).end is AttemptEnd.REACHED
    assert np.allclose(known.robot.pose, [8.0, 1.0, 0.0], atol=0.1)
    predicted.go(waypoint)
    assert predicted.robot.pose[0] < 5.0
