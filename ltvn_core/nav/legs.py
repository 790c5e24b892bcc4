"""One leg: drive to a waypoint, looking again on the way, and say why it ended.

Owns the loop between two control steps. Does not judge whether the leg reached its node.
"""

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from ltvn_core.config import Driving
from ltvn_core.geometry import compose, relative
from ltvn_core.nav.body import CONTROL_STEP_S, Body
from ltvn_core.nav.controller import drives_backwards, steer
from ltvn_core.nav.events import Event, LegEnd, Tick
from ltvn_core.nav.eyes import Eyes
from ltvn_core.nav.obstacle import is_blocked
from ltvn_core.types import Intrinsics, NodeId, Pose, Twist, Waypoint

_VETO_EVERY_STEPS = 2
_BRAKING_S = 0.3
"""Time in which the robot stops, so what it covers until then must be free."""
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
        self._intrinsics = intrinsics

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
            if self._vetoed(twist, step, goal):
                return LegResult(LegEnd.BLOCKED, step, goal)
            yield from body.move(twist)
            if body.collisions > touched or (step == 0 and body.touching and twist.linear_m_s):
                yield from self._back_off(backwards=backwards)
                return LegResult(LegEnd.COLLISION, step + 1, goal)
        return LegResult(LegEnd.TIMEOUT, config.leg_steps, goal)

    def _is_due(self, step: int, goal: Pose) -> bool:
        every = self._config.look_every_steps
        left = relative(self._body.odometry, goal)
        return bool(every and step and step % every == 0 and np.hypot(left[0], left[1]) > _FINISH_M)

    def is_free(self, ahead_m: float) -> bool:
        """Tell whether the current picture shows nothing in the way for `ahead_m`."""
        margin_m = self._config.veto_margin_m
        return not is_blocked(self._eyes.observation.depth, self._intrinsics, ahead_m=ahead_m, margin_m=margin_m)

    def _vetoed(self, twist: Twist, step: int, goal: Pose) -> bool:
        if not self._config.depth_veto or twist.linear_m_s <= 0 or step % _VETO_EVERY_STEPS:
            return False
        left = relative(self._body.odometry, goal)
        ahead_m = min(float(np.hypot(left[0], left[1])), twist.linear_m_s * (_BRAKING_S + CONTROL_STEP_S))
        return not self.is_free(ahead_m)

    def _back_off(self, *, backwards: bool) -> Generator[Event | Tick, None, None]:
        length_m = self._config.back_off_m if backwards else -self._config.back_off_m
        yield from self._body.advance(length_m, self._config.speed_m_s / 2)


def clipped(waypoint: Waypoint) -> Waypoint:
    """Return a waypoint (3,) no farther away than any the network was trained on."""
    length_m = float(np.hypot(waypoint[0], waypoint[1]))
    scale = min(1.0, _LONGEST_LEG_M / length_m) if length_m > 0 else 1.0
    return np.array([waypoint[0] * scale, waypoint[1] * scale, waypoint[2]])
