"""One attempt: drives to a waypoint, predicts it again on the way, and reports why the drive ended.

Owns the control loop of the attempt. Does not judge whether the robot reached its node.
"""

import itertools
from collections.abc import Generator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ltvn_core.cameras.depth_points import RELEVANT_RANGE_M, transform_points
from ltvn_core.config import DrivingConfig
from ltvn_core.geometry import agree, compose, invert, relative, wrap_angle
from ltvn_core.graph.node_layout import SAME_POSE
from ltvn_core.graph.presence.obstruction import distances_to_way
from ltvn_core.navigation import steering
from ltvn_core.navigation.bystanders import BODY_M, Bystanders
from ltvn_core.navigation.events import AttemptEnd, Event, Tick
from ltvn_core.navigation.obstacle_memory import Clearances, ObstacleMemory
from ltvn_core.navigation.perception import MotionExecutor, Perception
from ltvn_core.robots.robot_spec import RobotSpec
from ltvn_core.types import CONTROL_STEP_S, NodeId, Pose, Twist, Waypoint

_MAX_WAYPOINT_M = 2.5
"""Maximum length of a waypoint, in metres: the range in which the network was trained."""
_MOST_STEPS = 100
"""Maximum number of control steps in an attempt at a waypoint in that range; in proportion more beyond it."""
_BACK_OFF_M = 0.25
"""Distance in metres to back off after a collision; the paper gives none."""
_DETOUR_REACHED_M = 0.04
"""Distance within which the via point of a detour is reached, in metres; small, because the way is narrow there."""
_FRAMES_AROUND_TARGET, _FRAMES_AROUND_NODE = 8, 3
"""Number of images of the drive before and after the target, and before and after other nodes, that show the way to
back up."""
_NODES_AROUND = 12
"""Number of these nodes, the nearest ones."""
_BESIDE_WAY_M = 1.0
"""Distance from the way back beyond which mapped obstacles are ignored, in metres; the robot swerves less."""
_LOOK_AGAIN_STEPS = 3
"""Control steps after which a waiting robot looks again."""
_WAITED_FOR_M = 1.5
"""Distance within which the robot waits for people in its way, in metres."""
_CAREFUL_M, _SLOW_M_S, _SLOWER_1_S = 0.25, 0.15, 0.5
"""Speed limit near people: the second value up to the first distance; beyond it, the third is added per metre."""
_TURNED_RAD, _SLOWEST_TURN_RAD_S = 0.05, 0.2
_ARC_ROOM_M = 0.2
"""Length of free path that a car needs for one arc of a turn, in metres."""
_FARTHEST_BACKWARDS_M = 1.2
"""Longest way to a known place that the robot backs up, in metres, because its camera faces ahead."""
_FINAL_APPROACH_M = 0.3
"""Distance within which the waypoint is not predicted again, in metres."""


@dataclass(frozen=True, slots=True, eq=False)
class AttemptResult:
    """How an attempt ended."""

    end: AttemptEnd
    steps: int
    goal: Pose
    """(3,) last waypoint that the robot drove to, in the odometry frame."""


class AttemptDriver:
    """Drives one attempt."""

    def __init__(
        self,
        motion: MotionExecutor,
        perception: Perception,
        config: DrivingConfig,
        spec: RobotSpec,
        *,
        bystanders: Bystanders | None = None,
    ) -> None:
        """Drive with `motion`, using the images of `perception`; `bystanders` are the people met before."""
        self._motion = motion
        self._perception = perception
        self._turning = steering.TurningCircle(spec.speeds)
        self._config = config
        self._spec = spec
        patient = config.patience_s > 0
        self.obstacles = ObstacleMemory(spec, bystanders=(bystanders or Bystanders()) if patient else None)
        """What recent images and collisions showed around the robot."""
        self._patience_steps = 0
        self._backwards = self._turned_round = False
        self._behind = np.empty((0, 2))
        """(M, 2) obstacles behind the robot by images of the map, in the odometry frame, while it backs up."""
        self._detour: Pose | None = None
        self._detours_left = 0

    def drive(
        self, target: NodeId, waypoint: Waypoint, *, around: Mapping[NodeId, Pose], is_known: bool = False
    ) -> Generator[Event | Tick, None, AttemptResult]:
        """Drive to the waypoint (3,) of `target`, given in the robot's frame at departure.

        If the waypoint `is_known`, predictions on the way that contradict it, or do not find the target, are ignored.
        `around` are the poses (3,) of the nodes around the robot, the nearest first, if its place is known.
        """
        motion = self._motion
        config = self._config
        # Only predictions beyond the range of training are wrong; the map and odometry know far places as well.
        goal = compose(motion.odometry, waypoint if is_known else clip_waypoint(waypoint))
        most_steps = round(_MOST_STEPS * self._turning.legs * max(1.0, self._length_m(goal) / _MAX_WAYPOINT_M))
        collisions_before = motion.collisions
        self._reset(target, waypoint, around, is_known=is_known)
        for step in range(most_steps):
            # If the image cannot be compared, the robot keeps its waypoint.
            if self._needs_new_waypoint(step, goal) and (yield from self._perception.can_compare()):
                node_match = self._perception.node_match(target)
                if node_match.reachability < config.lost_reachability and not is_known:
                    return AttemptResult(AttemptEnd.LOST, step, goal)
                expected = relative(motion.odometry, goal)
                if not is_known:
                    goal = compose(motion.odometry, clip_waypoint(node_match.waypoint))
                elif agree(expected, node_match.waypoint, SAME_POSE):
                    goal = compose(motion.odometry, node_match.waypoint)
            twist = self._next(goal)
            if twist is AttemptEnd.BLOCKED and self._waits_for_somebody():
                yield from self._wait()
                continue
            if isinstance(twist, AttemptEnd):
                return AttemptResult(twist, step, goal)
            may_wait = twist.linear_m_s > 0 and self._patience_steps > 0
            if may_wait and self.obstacles.moves_ahead(motion.odometry):
                yield from self._wait()
                continue
            yield from motion.move(twist)
            was_in_contact = step == 0 and motion.state.bumper_pressed and twist.linear_m_s
            if motion.collisions > collisions_before or was_in_contact:
                self.obstacles.bump(motion.odometry, backwards=twist.linear_m_s < 0)
                yield from self._back_off(backwards=twist.linear_m_s < 0)
                return AttemptResult(AttemptEnd.COLLISION, step + 1, goal)
        return AttemptResult(AttemptEnd.TIMEOUT, most_steps, goal)

    def _waits_for_somebody(self) -> bool:
        """Tell whether to wait because people nearby may clear the way; if so, allow all detours again."""
        if self._patience_steps <= 0:
            return False
        people = self._people()
        if not ((people[:, 0] > 0) & (np.hypot(*people.T) < _WAITED_FOR_M)).any():
            return False
        self._detour = None
        self._detours_left = self._config.bends
        return True

    def _people(self) -> NDArray[np.float64]:
        """Return (N, 2) last known places of people, in the robot's frame."""
        state = self._motion.state
        return transform_points(self.obstacles.bystanders.near(state.stamp), invert(state.odometry))

    def _wait(self) -> Generator[Event | Tick, None, None]:
        for _ in range(_LOOK_AGAIN_STEPS):
            yield from self._motion.wait_one_step()
        self._patience_steps -= _LOOK_AGAIN_STEPS
        self.obstacles.add(self._perception.observation)

    def _needs_new_waypoint(self, step: int, goal: Pose) -> bool:
        if self._turned_round:
            return False  # The node is behind the robot, where it cannot be seen.
        every = self._config.look_every_steps
        return bool(every and step and step % every == 0 and self._length_m(goal) > _FINAL_APPROACH_M)

    def _length_m(self, goal: Pose) -> float:
        """Return the straight distance in metres to a pose (3,) in the odometry frame."""
        return float(np.hypot(*(goal - self._motion.odometry)[:2]))

    def _reset(self, target: NodeId, waypoint: Waypoint, around: Mapping[NodeId, Pose], *, is_known: bool) -> None:
        """Forget the previous attempt, and choose whether to back up or to turn round."""
        behind = steering.drives_backwards(waypoint)
        # A robot that backs up does not see approaching people, so with people nearby it turns round, too.
        about = self.obstacles.bystanders.are_about(self._motion.state.stamp)
        is_far = is_known and bool(np.hypot(waypoint[0], waypoint[1]) > _FARTHEST_BACKWARDS_M)
        self._turned_round = behind and (about or is_far or self._is_narrow(target, waypoint))
        self._backwards = behind and not self._turned_round
        if self._backwards:
            nearest = dict(itertools.islice(around.items(), _NODES_AROUND))
            points = self._perception.mapped_points(nearest, _FRAMES_AROUND_NODE, self._spec, range_m=RELEVANT_RANGE_M)
            points = points[distances_to_way(points, np.zeros(2), waypoint[:2]) < _BESIDE_WAY_M]
            self._behind = transform_points(points, self._motion.odometry)
        self._detour = None
        self._detours_left = self._config.bends
        self._patience_steps = round(self._config.patience_s / CONTROL_STEP_S)

    def _is_narrow(self, target: NodeId, waypoint: Waypoint) -> bool:
        """Tell whether the path backwards is narrow, by images of the mapping drive, because the camera faces ahead."""
        if not self._config.back_up_clearance_m:
            return False
        points = self._perception.mapped_points(
            {target: waypoint}, _FRAMES_AROUND_TARGET, self._spec, range_m=RELEVANT_RANGE_M
        )
        (clearance_m,) = Clearances(points).of_lines(np.zeros((1, 2)), waypoint[None, :2])
        return bool(clearance_m < self._config.back_up_clearance_m)

    def _next(self, goal: Pose) -> Twist | AttemptEnd:
        """Return the next command, or the reason why the attempt ends here."""
        while True:
            aim, reached_m = (goal, steering.REACHED_M) if self._detour is None else (self._detour, _DETOUR_REACHED_M)
            error, is_narrow = self._drivable_aim(relative(self._motion.odometry, aim))
            twist = self._turning.steer(
                error, self._config, backwards=self._backwards, is_narrow=is_narrow, reached_m=reached_m
            )
            if twist is None:
                if self._detour is None:
                    return AttemptEnd.REACHED
                self._detour = None
                continue
            free = self._drivable(twist, float(np.hypot(error[0], error[1])), is_narrow=is_narrow)
            if free is not None:
                return free
            if not self._try_another_way(goal):
                return AttemptEnd.BLOCKED

    def _drivable_aim(self, aim: Waypoint) -> tuple[Waypoint, bool]:
        """Return an aim (3,) in the robot's frame, moved to the middle of a narrow way, and whether the way is narrow.

        A robot that backs up does not see what is beside it, and a car cannot steer to a place so close.
        """
        if not self._config.swerve or self._backwards or self._spec.speeds.turning_radius_m:
            return aim, False
        points = self.obstacles.nearby_points(self._motion.odometry)
        place, is_narrow = steering.drivable_aim(aim[:2], points, radius_m=self._spec.clear_radius_m)
        return np.array([*place, aim[2]]), is_narrow

    def _try_another_way(self, goal: Pose) -> bool:
        """Turn round if backing up is blocked, because the camera faces ahead; otherwise plan a detour.

        Returns False after a few tries, or without a detour.
        """
        if not self._detours_left:
            return False
        if self._backwards:
            self._backwards = False
            self._turned_round = True
            return True
        self._detours_left -= 1
        odometry = self._motion.odometry
        ahead = relative(odometry, goal)[:2]
        place = steering.find_detour(ahead, self.obstacles.nearby_points(odometry), radius_m=self._spec.clear_radius_m)
        self._detour = None
        if place is not None:
            onward = ahead - place
            self._detour = compose(odometry, np.array([*place, np.arctan2(onward[1], onward[0])]))
        return self._detour is not None

    def _drivable(self, wish: Twist, length_m: float, *, is_narrow: bool = False) -> Twist | None:
        """Return a collision-free command that this body can drive instead of the desired one; None without any."""
        ways = self._turning.commands(wish, self._motion.odometry)
        commands = (self.avoid_obstacles(way, length_m, is_narrow=is_narrow) for way in ways)
        return next((command for command in commands if command is not None), None)

    def turn(self, angle_rad: float) -> Generator[Event | Tick, None, None]:
        """Turn on the spot by an angle, measured by odometry; a car without room for its arcs stops."""
        motion = self._motion
        goal_rad = motion.odometry[2] + angle_rad
        # Odometry may stand still when the robot is stuck, so the number of steps is bounded too.
        steps = 2 + int(2 * abs(angle_rad) / (steering.TURN_RAD_S * CONTROL_STEP_S))
        for _ in range(steps * self._turning.legs):
            left = abs(float(wrap_angle(goal_rad - motion.odometry[2])))
            if left < _TURNED_RAD:
                return
            rate = min(steering.TURN_RAD_S, max(_SLOWEST_TURN_RAD_S, left / CONTROL_STEP_S))
            twist = self._drivable(Twist(0.0, float(np.sign(angle_rad) * rate)), _ARC_ROOM_M)
            if twist is None:
                return
            yield from motion.move(twist)

    def avoid_obstacles(self, twist: Twist, length_m: float, *, is_narrow: bool = False) -> Twist | None:
        """Return the command nearest to `twist` that avoids obstacles; None if there is none.

        `is_narrow` means that a free way through a gap is known.
        """
        if not self._config.depth_veto or not twist.linear_m_s:
            return twist
        odometry = self._motion.odometry
        backwards = twist.linear_m_s < 0
        if self.obstacles.is_outdated(odometry, self._motion.state.stamp):
            self.obstacles.add(self._perception.observation)
        points = self.obstacles.nearby_points(odometry, backwards=backwards)
        if backwards and self._backwards:
            points = np.concatenate([points, transform_points(self._behind, invert(odometry))])
        twist = self._careful(twist)
        return steering.collision_free_command(
            twist, points, length_m, self._config, radius_m=self._spec.clear_radius_m, is_narrow=is_narrow
        )

    def _careful(self, twist: Twist) -> Twist:
        """Return a command slowed down near people; people whom the robot has passed are ignored."""
        people = self._people()
        people = people[people[:, 0] * np.sign(twist.linear_m_s) > 0]
        if not len(people):
            return twist
        gap_m = float(np.hypot(*people.T).min()) - self._spec.radius_m - BODY_M
        limit = _SLOW_M_S + _SLOWER_1_S * max(gap_m - _CAREFUL_M, 0.0)
        return Twist(float(np.clip(twist.linear_m_s, -limit, limit)), twist.angular_rad_s)

    def wander(self, length_m: float) -> Generator[Event | Tick, None, None]:
        """Drive straight on at half speed while the path is free; stop when a person approaches."""
        ahead = Twist(self._config.speed_m_s / 2, 0.0)
        if self.avoid_obstacles(ahead, length_m) == ahead:

            def nobody_comes() -> bool:
                is_alone = not self.obstacles.bystanders.are_about(self._motion.state.stamp)
                return is_alone or self.avoid_obstacles(ahead, ahead.linear_m_s) == ahead

            yield from self._motion.drive_straight(length_m, ahead.linear_m_s, goes_on=nobody_comes)

    def _back_off(self, *, backwards: bool) -> Generator[Event | Tick, None, None]:
        if self.obstacles.bystanders.are_about(self._motion.state.stamp):
            return  # The camera looks the other way, so the robot stands still and touches nobody.
        length_m = _BACK_OFF_M if backwards else -_BACK_OFF_M
        yield from self._motion.drive_straight(length_m, self._config.speed_m_s / 2)


def clip_waypoint(waypoint: Waypoint) -> Waypoint:
    """Return a waypoint (3,), shortened to the range in which the network was trained."""
    length_m = float(np.hypot(waypoint[0], waypoint[1]))
    scale = min(1.0, _MAX_WAYPOINT_M / length_m) if length_m > 0 else 1.0
    return np.array([waypoint[0] * scale, waypoint[1] * scale, waypoint[2]])
