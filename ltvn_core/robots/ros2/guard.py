"""The guard: a process beside the robot between whoever drives and the wheels. Works when everything else is dead.

Listens at the profile's `guard_topic`, and sends to its command topic what `CommandGate` lets through.
"""

import logging
import time
from collections.abc import Callable

from ltvn_core.errors import RobotError
from ltvn_core.robots.ros2.command_gate import CommandGate
from ltvn_core.robots.ros2.complaints import Complaints
from ltvn_core.robots.ros2.depth_stop import DepthStop
from ltvn_core.robots.ros2.freshness import MOST_LATE_COMMAND_S, Freshness
from ltvn_core.robots.ros2.profile import RobotProfile
from ltvn_core.robots.ros2.ros_cameras import CAMERA_INFO
from ltvn_core.robots.ros2.ros_messages import read_stamp, read_twist, twist_message
from ltvn_core.robots.ros2.ros_types import TWIST, TWIST_STAMPED
from ltvn_core.robots.ros2.sensor_topics import depth_topic
from ltvn_core.robots.ros2.topic_keys import Topic
from ltvn_core.robots.ros2.zenoh_link import Received, ZenohLink
from ltvn_core.types import ZERO_TWIST, Twist

_LOG = logging.getLogger(__name__)
TURN_S = 0.02
_HEADER_APART_S = 1.0
"""So far a command's own stamp may be from when it was sent."""


class Guard:
    """Forwards commands of one robot."""

    def __init__(self, link: ZenohLink, profile: RobotProfile, *, depth_stop_m: float | None = None) -> None:
        """Listen; with a `depth_stop_m` forward is refused where something stands so near before the body."""
        self.forwarded = 0
        """Commands that were passed on."""
        self.refused = 0
        """Commands that were not."""
        self._stamped = profile.driving.stamped
        self._source = profile.driving.guard_topic
        self._freshness = Freshness(self._source, most_late_s=MOST_LATE_COMMAND_S)
        self._complaints = Complaints()
        domain = profile.domain
        depth_stop = None if depth_stop_m is None else DepthStop(profile, depth_stop_m)
        self._gate = CommandGate(
            time.monotonic,
            speeds=profile.speeds,
            accelerations=profile.accelerations,
            allows=(lambda twist: twist) if depth_stop is None else depth_stop.allows,
        )
        kind = TWIST_STAMPED if self._stamped else TWIST
        self._command = profile.topics.command
        self._kind = kind
        self._wheels = link.command_publisher(Topic(self._command, kind, domain))
        if depth_stop is not None:
            link.subscribe(
                Topic(profile.topics.camera_info, CAMERA_INFO, domain),
                depth_stop.take_camera_info,
                self._complaints.say,
            )
            link.subscribe(depth_topic(profile), depth_stop.take_depth, self._complaints.say)
        link.subscribe(Topic(self._source, kind, domain), self._take, self._refuse)

    @property
    def has_listener(self) -> bool:
        """Whether anybody takes what is forwarded."""
        return self._wheels.has_listener

    def run(self, is_over: Callable[[], bool]) -> None:
        """Watch until it is over; the last thing sent is a zero."""
        try:
            while not is_over():
                time.sleep(TURN_S)
                was_open = not self._gate.must_stop_first
                self._send(self._gate.turn())
                if was_open and self._gate.must_stop_first:
                    self._complaints.say(
                        RobotError("No command came in time: the robot is stopped until its driver sends a stop.")
                    )
        finally:
            self._send(self._gate.close())

    def _take(self, received: Received) -> None:
        self._freshness.admit(received.attachment, received.arrived_s)
        twist = self._sound(received)
        answer = self._gate.hear(twist)
        self._send(answer)
        if answer is None:
            raise RobotError(f"{self._source}: after silence a driver sends a stop first; it is not driven yet.")
        self.forwarded += 1
        if not self.has_listener:
            self._complaints.say(
                RobotError(
                    f"Nobody listens at {self._command} for {self._kind}, so forwarded commands move nothing: is the "
                    "robot's driver running? `ros2 topic info -v` says who listens where; correct topics.command or "
                    "driving.stamped in the profile."
                )
            )

    def _sound(self, received: Received) -> Twist:
        """Return the speeds of a command. Raises RobotError, and stops the robot, where they cannot be meant."""
        try:
            twist = read_twist(received.message, self._source)
        except RobotError:
            self._send(self._gate.hear(ZERO_TWIST))
            raise
        if self._stamped and received.message.header.stamp.sec:
            apart_s = read_stamp(received.message, self._source) - received.attachment.stamp_ns * 1e-9
            if abs(apart_s) > _HEADER_APART_S:
                raise RobotError(
                    f"{self._source}: a command is stamped {apart_s:+.1f} s from when it was sent; refused."
                )
        return twist

    def _send(self, twist: Twist | None) -> None:
        if twist is not None:
            self._wheels.put(twist_message(twist, time.time() if self._stamped else None))

    def _refuse(self, error: RobotError) -> None:
        self.refused += 1
        self._complaints.say(error)
