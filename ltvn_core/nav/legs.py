"""One leg: drive to a waypoint, looking again on the way, and say why it ended.

Owns the loop between two control steps. Does not judge whether the leg reached its node.
"""

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from ltvn_core.config import Driving
from ltvn_core.geometry import compose, relative
from ltvn_core.nav.body import Body
from ltvn_core.nav.controller import drives_backwards, steer
from ltvn_core.nav.events import Event, LegEnd, Tick
from ltvn_core.nav.eyes import Eyes
from ltvn_core.nav.obstacle import Surroundings
from ltvn_core.nav.swerve import free_command
from ltvn_core.types import Intrinsics, NodeId, Pose, Twist, Waypoint

_LONGEST_LEG_M = 2.5
"""No waypoint is believed beyond the range in which the network learned."""
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
        self._config = config
        self._surroundings = Surroundings(intrinsics)

    def drive(self, target: NodeId, waypoint: Waypoint) -> Generator[Event | Tick, None, LegResult]:
        """Drive to a waypoint (3,) given in the robot's frame now, at which `target` should be."""
        body, config = self._body, self._config
        goal = compose(body.odometry, clipped(waypoint))
        backwards = drives_backwards(waypoint)
        touched = body.collisions
        for step in range(config.leg_steps):
            if self._is_due(step, goal):
                sight = self._eyes.sight(target)
                if sight.reachability < config.lost_reachability:
                    return LegResult(LegEnd.LOST, step, goal)
                goal = compose(body.odometry, clipped(sight.waypoint))
            twist = steer(relative(body.odometry, goal), config, backwards=backwards)
            if twist is None:
                return LegResult(LegEnd.REACHED, step, goal)
            twist = self.cleared(twist, float(np.hypot(*relative(body.odometry, goal)[:2])))
            if twist is None:
                return LegResult(LegEnd.BLOCKED, step, goal)
            yield from body.move(twist)
            if body.collisions > touched or (step == 0 and body.touching and twist.linear_m_s):
                self._surroundings.bump(body.odometry, backwards=twist.linear_m_s < 0)
                yield from self._back_off(backwards=twist.linear_m_s < 0)
                return LegResult(LegEnd.COLLISION, step + 1, goal)
        return LegResult(LegEnd.TIMEOUT, config.leg_steps, goal)

    def _is_due(self, step: int, goal: Pose) -> bool:
        every = self._config.look_every_steps
        left = relative(self._body.odometry, goal)
        return bool(every and step and step % every == 0 and np.hypot(left[0], left[1]) > _FINISH_M)

    def cleared(self, twist: Twist, length_m: float) -> Twist | None:
        """Return a command as near to `twist` as what stands around allows, None if nothing does."""
        if not self._config.depth_veto or not twist.linear_m_s:
            return twist
        if self._surroundings.needs_look(self._body.odometry):
            self._surroundings.add(self._eyes.observation)
        points = self._surroundings.around(self._body.odometry)
        return free_command(twist, points, length_m, self._config)

    def _back_off(self, *, backwards: bool) -> Generator[Event | Tick, None, None]:
        length_m = self._config.back_off_m if backwards else -self._config.back_off_m
        yield from self._body.advance(length_m, self._config.speed_m_s / 2)


def clipped(waypoint: Waypoint) -> Waypoint:
    """Return a waypoint (3,) no farther away than any the network was trained on."""
    length_m = float(np.hypot(waypoint[0], waypoint[1]))
    scale = min(1.0, _LONGEST_LEG_M / length_m) if length_m > 0 else 1.0
    return np.array([waypoint[0] * scale, waypoint[1] * scale, waypoint[2]])
