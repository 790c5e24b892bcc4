"""The guard: a watchdog process on the robot, between the driver and the wheels. Works if all other processes fail.

Subscribes to the profile's `guard_topic`, and forwards the commands that `CommandGate` accepts to its command topic:
fresh commands within the limits, and one zero when they stop. At the beginning, after silence, and after a pause of the
guard itself, and after an invalid command, a driver must send a zero before it may drive. `DepthStop` refuses forward
motion unless fresh depth shows a free corridor ahead, so that a covered or failed camera also stops the robot. Whether
and why commands are refused is published at its guard topic + `_status`.
"""

import logging
import math
import threading
import time
from collections.abc import Callable

from ltvn_core.errors import RobotError
from ltvn_core.robots.robot_spec import AccelerationLimits, SpeedLimits
from ltvn_core.robots.ros2.depth_stop import DepthStop
from ltvn_core.robots.ros2.freshness import MOST_LATE_COMMAND_S, Freshness
from ltvn_core.robots.ros2.profile import RobotProfile
from ltvn_core.robots.ros2.robot_topics import RobotTopics
from ltvn_core.robots.ros2.ros_messages import (
    GuardState,
    GuardStatus,
    guard_status_message,
    read_stamp,
    read_twist,
    twist_message,
)
from ltvn_core.robots.ros2.zenoh_link import Received, ZenohLink
from ltvn_core.types import ZERO_TWIST, Twist

SILENCE_S = 0.2
"""Time without commands after which a driver counts as gone, in seconds. Including checking, sending and braking, the
robot stands still within 300 ms; commands arrive 20 times a second."""
PAUSE_S = 0.3
"""Time between two iterations above which the guard itself was paused, in seconds."""
_LOG = logging.getLogger(__name__)
TURN_S = 0.02
_STATUS_S = 0.2
"""Interval at which the status is published even if it has not changed, in seconds, because messages get lost."""
_HEADER_APART_S = 1.0
"""Greatest difference between the stamp of a command and its time of sending, in seconds."""


class CommandGate:
    """The gate of one robot. Safe to use from several threads."""

    def __init__(
        self,
        clock: Callable[[], float],
        *,
        speeds: SpeedLimits,
        accelerations: AccelerationLimits,
        allows: Callable[[Twist], Twist] = lambda twist: twist,
    ) -> None:
        """Start with a stop; `allows` returns the part of a command that the surroundings permit."""
        self._clock = clock
        self._speeds = speeds
        self._accelerations = accelerations
        self._allows = allows
        self._lock = threading.Lock()
        self._wanted = ZERO_TWIST
        self._output = ZERO_TWIST
        self._heard_s = -math.inf
        self._asked_s = clock()
        self._must_stop_first = True
        self._refuses_because = ""

    @property
    def refuses_because(self) -> str:
        """Reason why a driver that has not sent a stop since is refused; empty if no driver is."""
        return self._refuses_because

    @property
    def is_restrained(self) -> bool:
        """Whether the surroundings permit less than the driver commands."""
        wanted = self._wanted
        return wanted != ZERO_TWIST and self._allows(wanted) != wanted

    def hear(self, twist: Twist) -> Twist | None:
        """Accept a fresh command; return the command to send now, None to send nothing."""
        with self._lock:
            now_s = self._clock()
            pause = self._after_pause(now_s)
            if twist == ZERO_TWIST:
                self._must_stop_first = False
                self._refuses_because = ""
            elif self._must_stop_first:
                self._refuses_because = self._refuses_because or "it started while the robot was driven"
                return pause
            self._heard_s = now_s
            self._wanted = self._speeds.bounded(twist)
            return self._next(now_s)

    def turn(self) -> Twist | None:
        """Return the command to send when no new one has arrived; None to send nothing. Must be called 50 times a
        second."""
        with self._lock:
            now_s = self._clock()
            pause = self._after_pause(now_s)
            if pause is not None:
                return pause
            if self._wanted == ZERO_TWIST:
                self._asked_s = now_s
                return None
            if now_s - self._heard_s >= SILENCE_S:
                return self._halt(f"no command arrived for {now_s - self._heard_s:.1f} s")
            return self._next(now_s)

    def halt(self, because: str) -> Twist:
        """Refuse all commands until the driver sends a stop; return the zero to send now."""
        with self._lock:
            return self._halt(because)

    def _after_pause(self, now_s: float) -> Twist | None:
        """Return a zero if this process was paused while the robot drove."""
        gap_s = now_s - self._asked_s
        if gap_s <= PAUSE_S or self._wanted == ZERO_TWIST:
            return None
        self._asked_s = now_s
        return self._halt(f"it did not run for {gap_s:.1f} s")

    def _halt(self, because: str) -> Twist:
        self._wanted = self._output = ZERO_TWIST
        self._must_stop_first = True
        self._refuses_because = because
        return ZERO_TWIST

    def _next(self, now_s: float) -> Twist:
        """Return a velocity closer to the desired one, within the accelerations; a zero is returned at once."""
        passed_s, self._asked_s = min(max(now_s - self._asked_s, 0.0), 0.1), now_s
        goal = self._allows(self._wanted)
        if goal == ZERO_TWIST:
            self._output = ZERO_TWIST
            return ZERO_TWIST
        most = self._accelerations
        speeding_up = most.linear_m_s2, most.angular_rad_s2
        braking = most.linear_braking_m_s2, most.angular_braking_rad_s2
        axes = zip(self._output, goal, speeding_up, braking, strict=True)
        self._output = self._speeds.curved(Twist(*(_towards(*axis, passed_s) for axis in axes)))
        return self._output


def _towards(speed: float, goal: float, speeding_up: float, braking: float, passed_s: float) -> float:
    """Return a speed closer to the goal, by at most the allowed change."""
    is_braking = abs(goal) < abs(speed) or goal * speed < 0
    most = passed_s * (braking if is_braking else speeding_up)
    return speed + min(max(goal - speed, -most), most)


class Guard:
    """Forwards commands to one robot."""

    def __init__(self, link: ZenohLink, profile: RobotProfile, *, depth_stop_m: float | None = None) -> None:
        """Subscribe; with `depth_stop_m`, allow forward motion only if depth shows this way before the body free."""
        self.forwarded = 0
        """Number of forwarded commands."""
        self.refused = 0
        """Number of refused commands."""
        topics = RobotTopics.of(profile)
        self._link = link
        self._stamped = profile.driving.stamped
        self._source = topics.guard.name
        self._command = topics.command
        self._freshness = Freshness(self._source, most_late_s=MOST_LATE_COMMAND_S)
        self._depth_stop = depth_stop = None if depth_stop_m is None else DepthStop(profile, depth_stop_m)
        self._gate = CommandGate(
            time.monotonic,
            speeds=profile.speeds,
            accelerations=profile.accelerations,
            allows=(lambda twist: twist) if depth_stop is None else depth_stop.allows,
        )
        self._wheels = link.command_publisher(topics.command)
        self._status = link.publisher(topics.guard_status)
        self._published: GuardStatus | None = None
        self._published_s = -math.inf
        if depth_stop is not None:
            link.subscribe(topics.camera_info, depth_stop.take_camera_info)
            link.subscribe(topics.depth, depth_stop.take_depth)
        link.subscribe(topics.guard, self._take, self._refuse)

    @property
    def has_listener(self) -> bool:
        """Whether forwarded commands have a subscriber."""
        return self._wheels.has_listener

    def run(self, is_over: Callable[[], bool]) -> None:
        """Forward commands until `is_over` returns True; the last command is a zero."""
        try:
            while not is_over():
                time.sleep(TURN_S)
                self._send(self._gate.turn())
                self._publish_status()
        finally:
            self._send(self._gate.halt("it has ended"))
            self._status.put(guard_status_message(self.status))

    @property
    def status(self) -> GuardStatus:
        """Whether commands are forwarded now, and if not, why."""
        if reason := self._gate.refuses_because:
            return GuardStatus(GuardState.REFUSES, reason)
        if self._depth_stop is not None and self._gate.is_restrained:
            return GuardStatus(GuardState.RESTRAINS, self._depth_stop.reason or "")
        return GuardStatus(GuardState.FORWARDS)

    def _publish_status(self) -> None:
        """Publish the status after each change of state, and at intervals."""
        status, now_s = self.status, time.monotonic()
        before = GuardState.FORWARDS if self._published is None else self._published.state
        if status.state is before and now_s - self._published_s < _STATUS_S:
            return
        if status.state is GuardState.REFUSES and before is not GuardState.REFUSES:
            self._link.complain(RobotError(f"The robot is stopped until its driver sends a stop: {status.reason}."))
        self._published, self._published_s = status, now_s
        self._status.put(guard_status_message(status))

    def _take(self, received: Received) -> None:
        self._freshness.admit(received.attachment, received.arrived_s)
        twist = self._sound(received)
        answer = self._gate.hear(twist)
        self._send(answer)
        if answer is None:
            raise RobotError(
                f"{self._source}: after a silence the driver must first send a stop; its commands are refused until "
                "then."
            )
        self.forwarded += 1
        if not self.has_listener:
            self._link.complain(
                RobotError(
                    f"No node subscribes to {self._command.name} as {self._command.type_name}, so forwarded commands "
                    "have no effect: is the robot's driver running, and is driving.stamped of the profile right?"
                )
            )

    def _sound(self, received: Received) -> Twist:
        """Return the speeds of a command. If they are invalid, stop the robot and raise RobotError."""
        try:
            twist = read_twist(received.message, self._source)
        except RobotError:
            # A driver that sends invalid speeds is broken; what it sent is no stop, so it must send one.
            self._send(self._gate.halt("a command was invalid"))
            raise
        if self._stamped and received.message.header.stamp.sec:
            apart_s = read_stamp(received.message, self._source) - received.attachment.stamp_ns * 1e-9
            if abs(apart_s) > _HEADER_APART_S:
                raise RobotError(
                    f"{self._source}: a command is stamped {apart_s:+.1f} s away from its time of sending; it is "
                    "refused."
                )
        return twist

    def _send(self, twist: Twist | None) -> None:
        if twist is not None:
            self._wheels.put(twist_message(twist, time.time() if self._stamped else None))

    def _refuse(self, error: RobotError) -> None:
        self.refused += 1
