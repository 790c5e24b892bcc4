"""One leg: drive to a waypoint, looking again on the way, and say why it ended.

Owns the loop between two control steps. Does not judge whether the leg reached its node.
"""

from collections.abc import Generator
from dataclasses import dataclass, replace

import numpy as np

from ltvn_core.config import Driving
from ltvn_core.geometry import compose, relative
from ltvn_core.nav.bend import clearance, place_to_bend
from ltvn_core.nav.body import Body
from ltvn_core.nav.controller import drives_backwards, steer
from ltvn_core.nav.events import Event, LegEnd, Tick
from ltvn_core.nav.eyes import Eyes
from ltvn_core.nav.obstacle import Surroundings, placed, solid_points
from ltvn_core.nav.swerve import free_command
from ltvn_core.types import Intrinsics, NodeId, Pose, Twist, Waypoint

_LONGEST_LEG_M = 2.5
"""No waypoint is believed beyond the range in which the network learned."""
_BEND_M = 0.04
"""Where a way is narrow enough to need a bend, the bend must be where it was meant to be."""
_SEEN_AROUND = 8
"""So many images of the drive before and after a node tell what stands around it."""
_FINISH_M = 0.3
"""So near, the waypoint is not predicted anew."""


@dataclass(frozen=True, slots=True, eq=False)
class LegResult:
    """How a leg ended."""

    end: LegEnd
    steps: int
    goal: Pose
    """(3,): the waypoint last driven to, in the odometry frame."""


class Leg:
    """Drives one leg."""

    def __init__(self, body: Body, eyes: Eyes, config: Driving, intrinsics: Intrinsics) -> None:
        """Drive with `body`, looking through `eyes`."""
        self._body = body
        self._eyes = eyes
        self._config, self._at_bends = config, replace(config, position_tolerance_m=_BEND_M)
        self._intrinsics, self._surroundings = intrinsics, Surroundings(intrinsics)
        self._backwards = self._turned_round = False
        self._bend: Pose | None = None
        self._bends_left = 0

    def drive(self, target: NodeId, waypoint: Waypoint) -> Generator[Event | Tick, None, LegResult]:
        """Drive to a waypoint (3,) given in the robot's frame now, at which `target` should be."""
        body, config = self._body, self._config
        goal = compose(body.odometry, clipped(waypoint))
        touched = body.collisions
        self._begin(target, waypoint)
        for step in range(config.leg_steps):
            if self._is_due(step, goal):
                sight = self._eyes.sight(target)
                if sight.reachability < config.lost_reachability:
                    return LegResult(LegEnd.LOST, step, goal)
                goal = compose(body.odometry, clipped(sight.waypoint))
            twist = self._next(goal)
            if isinstance(twist, LegEnd):
                return LegResult(twist, step, goal)
            yield from body.move(twist)
            if body.collisions > touched or (step == 0 and body.touching and twist.linear_m_s):
                self._surroundings.bump(body.odometry, backwards=twist.linear_m_s < 0)
                yield from self._back_off(backwards=twist.linear_m_s < 0)
                return LegResult(LegEnd.COLLISION, step + 1, goal)
        return LegResult(LegEnd.TIMEOUT, config.leg_steps, goal)

    def _is_due(self, step: int, goal: Pose) -> bool:
        if self._turned_round:
            return False  # The node is behind the robot, where it cannot be seen.
        every = self._config.look_every_steps
        left = relative(self._body.odometry, goal)
        return bool(every and step and step % every == 0 and np.hypot(left[0], left[1]) > _FINISH_M)

    def _begin(self, target: NodeId, waypoint: Waypoint) -> None:
        """Forget how the last leg went."""
        behind = drives_backwards(waypoint)
        self._turned_round = behind and self._is_narrow(target, waypoint)
        self._backwards = behind and not self._turned_round
        self._bend, self._bends_left = None, self._config.bends

    def _is_narrow(self, target: NodeId, waypoint: Waypoint) -> bool:
        """Tell whether a way back is narrow; the mapping drive saw what is there, the robot's own camera cannot."""
        if not self._config.back_up_clearance_m:
            return False
        seen = [
            placed(solid_points(image.depth, self._intrinsics), compose(waypoint, pose))
            for image, pose in self._eyes.images_around(target, _SEEN_AROUND)
        ]
        return clearance(waypoint[:2], np.concatenate(seen)) < self._config.back_up_clearance_m

    def _next(self, goal: Pose) -> Twist | LegEnd:
        """Return the next command, or how the leg ends here."""
        while True:
            aim, config = (goal, self._config) if self._bend is None else (self._bend, self._at_bends)
            error = relative(self._body.odometry, aim)
            twist = steer(error, config, backwards=self._backwards)
            if twist is None:
                if self._bend is None:
                    return LegEnd.REACHED
                self._bend = None
                continue
            free = self.cleared(twist, float(np.hypot(error[0], error[1])))
            if free is not None:
                return free
            if not self._finds_another_way(goal):
                return LegEnd.BLOCKED

    def _finds_another_way(self, goal: Pose) -> bool:
        """Turn round where backing up is blocked, for the camera looks ahead; else look for a bend, a few times."""
        if not self._bends_left:
            return False
        if self._backwards:
            self._backwards, self._turned_round = False, True
            return True
        self._bends_left -= 1
        self._bend = self._way_round(goal)
        return self._bend is not None

    def _way_round(self, goal: Pose) -> Pose | None:
        """Return where to turn, and how to stand there, on the way to a pose (3,) that is not straight ahead."""
        odometry, ahead = self._body.odometry, relative(self._body.odometry, goal)[:2]
        place = place_to_bend(ahead, self._surroundings.around(odometry))
        if place is None:
            return None
        onward = ahead - place
        return compose(odometry, np.array([*place, np.arctan2(onward[1], onward[0])]))

    def cleared(self, twist: Twist, length_m: float) -> Twist | None:
        """Return a command as near to `twist` as what stands around allows, None if nothing does."""
        if not self._config.depth_veto or not twist.linear_m_s:
            return twist
        if self._surroundings.needs_look(self._body.odometry):
            self._surroundings.add(self._eyes.observation)
        points = self._surroundings.around(self._body.odometry, backwards=twist.linear_m_s < 0)
        return free_command(twist, points, length_m, self._config)

    def _back_off(self, *, backwards: bool) -> Generator[Event | Tick, None, None]:
        length_m = self._config.back_off_m if backwards else -self._config.back_off_m
        yield from self._body.advance(length_m, self._config.speed_m_s / 2)


def clipped(waypoint: Waypoint) -> Waypoint:
    """Return a waypoint (3,) no farther away than any the network was trained on."""
    length_m = float(np.hypot(waypoint[0], waypoint[1]))
    scale = min(1.0, _LONGEST_LEG_M / length_m) if length_m > 0 else 1.0
    return np.array([waypoint[0] * scale, waypoint[1] * scale, waypoint[2]])
