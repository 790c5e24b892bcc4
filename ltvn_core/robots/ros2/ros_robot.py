"""A robot of ROS 2 behind the `Robot` protocol: its newest image with depth and odometry, and its commands.

Owns the limits of stale data. Opened by `open_ros_robot` from PROFILE@ADDRESS, as in turtlebot4@tcp/192.168.0.7:7447.

A thread sends commands 20 times a second, under a lease. When the lease ends, exactly one zero follows; a stop is a
zero at once. After an interruption of the link or of this program, commands are ignored until the driver has released
the controls for a moment, so that driving does not resume by itself.
"""

import logging
import math
import threading
import time
from collections.abc import Callable
from typing import Any

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.errors import DriveError, LtvnError, RobotError, RobotPausedError
from ltvn_core.robots.drive_lease import LEASE_S, DriveLease
from ltvn_core.robots.link_report import STALE_S, LinkReport
from ltvn_core.robots.robot import WallClock
from ltvn_core.robots.robot_spec import RobotSpec, SpeedLimits
from ltvn_core.robots.ros2.profile import RobotProfile, open_profile
from ltvn_core.robots.ros2.robot_topics import RobotTopics
from ltvn_core.robots.ros2.ros_cameras import is_calibrated, ros_camera
from ltvn_core.robots.ros2.ros_images import decode_colours, decode_metres, image_size
from ltvn_core.robots.ros2.ros_messages import GuardState, read_guard_status, twist_message
from ltvn_core.robots.ros2.sensor_inbox import Moment, SensorInbox
from ltvn_core.robots.ros2.zenoh_link import Received, ZenohLink
from ltvn_core.types import CONTROL_STEP_S, ZERO_TWIST, Observation, Pose, RobotState, Twist

_LOG = logging.getLogger(__name__)
_EVERY_S = 0.05
_BREAK_S = LEASE_S
"""Time between two iterations of the sender that counts as an interruption, in seconds: the program was paused or the
machine slept, and the robot has stopped."""
_BRIEF_S = 2.0
"""Length of a pause of this program, in seconds, above which a query does not continue by itself."""
LET_GO_S = 0.5
"""Time without commands after which the driver has released the controls, in seconds."""
_ON_THE_WAY_S = 0.3
"""Age of a command, in seconds, below which a status of the guard may have been sent before the guard received it."""
_CLOCKS_APART_S = 1.0
_FIRST_S = 3.0
_PATIENCE_S = 10.0
"""Time that a robot may take to send its first image, in seconds."""


class CommandSender:
    """Sends all commands to the robot."""

    def __init__(self, send: Callable[[Twist], Any], is_connected: Callable[[], bool], limits: SpeedLimits) -> None:
        """Start with a stop; `send` transmits a command."""
        self.lease = DriveLease(time.monotonic, limits=limits)
        self._reason: str | None = None
        self.was_paused = False
        """Whether the last interruption was only a brief pause of this program, or of the stream of commands."""
        self._asked_s = -math.inf
        self._send = send
        self._is_connected = is_connected
        self._moving = False
        self._moving_since_s = math.inf
        self._closed = False
        self._lock = threading.Lock()
        self._wake = threading.Event()
        self._send(ZERO_TWIST)
        self._thread = threading.Thread(target=self._run, name="commands", daemon=True)
        self._thread.start()

    @property
    def break_reason(self) -> str | None:
        """Reason why commands are ignored until the driver releases the controls; None if they are obeyed."""
        if self._reason is not None and time.monotonic() - self._asked_s >= LET_GO_S:
            self._reason = None
        return self._reason

    def drive(self, twist: Twist) -> None:
        """Command a velocity for the time of a lease. Raises ValueError if a speed is not finite."""
        is_broken = self.break_reason is not None
        self._asked_s = time.monotonic()
        if not is_broken:
            self.lease.grant(twist)
            self._wake.set()

    def interrupt(self, reason: str) -> None:
        """Stop; if the robot is driven, ignore commands until the driver has released the controls."""
        self.lease.cancel()
        self._wake.set()
        if self.break_reason is None and time.monotonic() - self._asked_s < LET_GO_S:
            self._break(reason)

    def refused(self, reason: str) -> None:
        """Stop if the robot is driven, because its guard refuses all commands until it receives a stop.

        A query continues afterwards: it was only a gap in the stream of commands.
        """
        with self._lock:
            if self._moving and time.monotonic() - self._moving_since_s > _ON_THE_WAY_S:
                self._break(reason, was_paused=True)
                self._wake.set()

    def stop(self) -> None:
        """Send a zero now."""
        with self._lock:
            self.lease.cancel()
            self._moving = False
            self._send(ZERO_TWIST)

    def close(self) -> None:
        """Stop for good."""
        self._closed = True
        self._wake.set()
        self._thread.join()
        self.stop()

    def _run(self) -> None:
        turned_s = time.monotonic()
        while not self._closed:
            self._wake.wait(_EVERY_S)
            self._wake.clear()
            now_s = time.monotonic()
            self._turn(now_s - turned_s)
            turned_s = now_s

    def _turn(self, took_s: float) -> None:
        with self._lock:
            if self._moving and took_s > _BREAK_S:
                reason = f"this program did not run for {took_s:.1f} s while the robot drove"
                self._break(reason, was_paused=took_s < _BRIEF_S)
            elif self._moving and not self._is_connected():
                self._break("the link to the robot broke")
            twist = self.lease.command()
            if twist != ZERO_TWIST and not self._moving:
                self._moving_since_s = time.monotonic()
                self._send(ZERO_TWIST)  # A guard that was started in between accepts commands only after a stop.
            if twist != ZERO_TWIST or self._moving:
                self._send(twist)
            self._moving = twist != ZERO_TWIST

    def _break(self, reason: str, *, was_paused: bool = False) -> None:
        self.lease.cancel()
        self.was_paused = was_paused  # Before the reason, because another thread reads both.
        self._reason = reason
        self._asked_s = time.monotonic()  # Start the waiting time now, because the driver may still hold the controls.
        _LOG.warning("The robot is stopped: %s. Release the controls, then drive again.", reason)


def open_ros_robot(wanted: str, *, patience_s: float = _PATIENCE_S) -> "RosRobot":
    """Connect to PROFILE@ADDRESS and wait for its first image. Drives nothing. Raises RobotError."""
    profile, link = connect(wanted, node="ltvn")
    try:
        return RosRobot(link, profile, patience_s=patience_s)
    except LtvnError:
        link.close()
        raise


def connect(wanted: str, *, node: str) -> tuple[RobotProfile, ZenohLink]:
    """Return the profile in PROFILE@ADDRESS, and a link to the router there. Raises RobotError."""
    name, _, address = wanted.rpartition("@")
    profile = open_profile(name)
    return profile, ZenohLink.connect(address, node=node, domain=profile.domain)


class RosRobot:
    """A robot connected by a link. Implements `ltvn_core.robots.robot.Robot`."""

    def __init__(self, link: ZenohLink, profile: RobotProfile, *, patience_s: float = _PATIENCE_S) -> None:
        """Wait for a message on each of the robot's topics. Raises RobotError with the names of the silent ones."""
        self.profile = profile
        self.link = link
        self.clock = WallClock()
        self.inbox = SensorInbox(profile)
        topics = RobotTopics.of(profile)
        self.inbox.subscribe(link, topics)
        if not self.inbox.wait_for_all(patience_s):
            raise RobotError(
                f"{profile.name} at {link.address}: within {patience_s:g} s some messages did not arrive: "
                f"{self.inbox.complaint(time.monotonic())}. Compare the profile with `ros2 topic list -t`; the robot "
                "must run rmw_zenoh."
            )
        first = self._newest()
        self._spec = profile.spec(self._lens(first))
        self._began_s = first.stamp_s - (self.clock.now() - (time.monotonic() - first.arrived_s))
        self._seen: tuple[Moment, Observation] | None = None
        self._step = 0
        self._commands = link.command_publisher(topics.guard if profile.driving.guarded else topics.command)
        self._sender = CommandSender(self._send, lambda: link.is_connected, profile.speeds)
        self._restrained_because = ""
        self._restrained_s = -math.inf
        if profile.driving.guarded:
            link.subscribe(topics.guard_status, self._take_guard_status)

    @property
    def spec(self) -> RobotSpec:
        """The profile's properties, with the lens that the robot published."""
        return self._spec

    @property
    def age_s(self) -> float:
        """Time since the newest complete image arrived, in seconds."""
        return time.monotonic() - self._newest().arrived_s

    def observe(self) -> Observation:
        """Return the newest image with depth and odometry of the same time.

        Raises RobotError if it is older than 0.5 s, or after an interruption until the driver releases the controls;
        RobotPausedError if the interruption was only a brief pause of this program or of the stream of commands.
        """
        if self._seen is None:  # A busy start may have made the last image stale.
            ends_s = time.monotonic() + _FIRST_S
            while self.age_s > STALE_S and time.monotonic() < ends_s:
                time.sleep(0.02)
        if self.inbox.newest() is None:
            self._sender.interrupt("it sends no complete images")
        moment = self._newest()
        age_s = time.monotonic() - moment.arrived_s
        if age_s > STALE_S:
            self._sender.interrupt(f"its images stopped for {age_s:.1f} s")
            link = "" if self.link.is_connected else " The link is broken; it reconnects automatically."
            raise RobotError(
                f"{self.profile.name}: its newest image is {age_s:.1f} s old, so it is not driven: "
                f"{self.inbox.complaint(time.monotonic())}.{link}"
            )
        if (reason := self._sender.break_reason) is not None:
            kind = RobotPausedError if self._sender.was_paused else RobotError
            raise kind(f"{self.profile.name} was stopped: {reason}. Release the controls, then drive again.")
        if self._seen is None or (self._seen[0] is not moment and self._seen[0].stamp_s != moment.stamp_s):
            self._seen = moment, self._decoded(moment)
        return self._seen[1]

    @property
    def true_pose(self) -> Pose | None:
        """Current true pose (3,) from motion capture or a simulator, only to evaluate runs; None without any."""
        kept = self.inbox.truth.kept
        return kept[-1].content if kept and time.monotonic() - kept[-1].arrived_s <= STALE_S else None

    def state(self) -> RobotState:
        """Return the newest odometry, and the bumper if the profile names its topic."""
        kept = self.inbox.odometry.kept
        if not kept:
            raise RobotError(f"{self.profile.name}: {self.inbox.complaint(time.monotonic())}.")
        newest = kept[-1]
        stamp = self._own_s(newest.stamp_s, newest.arrived_s)
        touches = self.inbox.bumper_pressed(time.monotonic())
        return RobotState(newest.content, stamp, max(self._step, int(stamp / CONTROL_STEP_S)), touches)

    def drive(self, twist: Twist) -> None:
        """Command a velocity for the time of a lease; ignored after an interruption until the controls are released."""
        self._sender.drive(twist)

    def stop(self) -> None:
        """Send a zero now."""
        self._sender.stop()

    def link_report(self) -> LinkReport:
        """Return the current quality of the connection."""
        now_s = time.monotonic()
        inbox = self.inbox
        moment = inbox.newest()
        odometry_age_s = inbox.odometry.age_s(now_s)
        return LinkReport(
            is_connected=self.link.is_connected,
            picture_age_s=math.inf if moment is None else now_s - moment.arrived_s,
            odometry_age_s=math.inf if odometry_age_s is None else odometry_age_s,
            pictures_hz=inbox.colour.rate_hz(now_s),
            lost_share=inbox.colour.lost_share,
            battery=inbox.battery,
            stopped_because=self._sender.break_reason,
            restrained_because=(now_s - self._restrained_s <= STALE_S and self._restrained_because) or None,
        )

    def close(self) -> None:
        """Stop, and disconnect."""
        self._sender.close()
        self.link.close()

    @property
    def has_listener(self) -> bool:
        """Whether the guard or the robot subscribes to commands."""
        return self._commands.has_listener

    def _take_guard_status(self, received: Received) -> None:
        status = read_guard_status(received.message)
        self._restrained_because = status.reason if status.state is GuardState.RESTRAINS else ""
        self._restrained_s = received.arrived_s
        if status.state is GuardState.REFUSES:
            self._sender.refused(f"the guard on the robot stopped it, because {status.reason}")

    def _newest(self) -> Moment:
        moment = self.inbox.newest()
        if moment is None:
            raise RobotError(f"{self.profile.name}: no complete image: {self.inbox.complaint(time.monotonic())}.")
        return moment

    def _lens(self, moment: Moment) -> CameraModel:
        topics = self.profile.topics
        info = self.inbox.camera_info
        if not is_calibrated(info):
            raise RobotError(
                f"{topics.camera_info} has no calibration of the lens, only zeros; calibrate the camera on the robot."
            )
        try:
            size = image_size(moment.colour, topics.colour)
            return ros_camera(info, *size, rectified=self.profile.camera.rectified, topic=topics.camera_info)
        except LtvnError as error:
            raise RobotError(str(error)) from error

    def _decoded(self, moment: Moment) -> Observation:
        topics = self.profile.topics
        wanted = self._spec.camera.width, self._spec.camera.height
        try:
            for message, topic in ((moment.colour, topics.colour), (moment.depth, topics.depth)):
                width, height = image_size(message, topic)
                if (width, height) != wanted:
                    raise RobotError(
                        f"{topic} is now {width} x {height}, but {topics.colour} was {wanted[0]} x {wanted[1]} at "
                        "first; name the topic of depth that is aligned with the colours, or open the robot again if "
                        "the camera's settings were changed."
                    )
            rgb = decode_colours(moment.colour, topics.colour)
            depth = decode_metres(moment.depth, topics.depth, self.profile.camera.depth_unit_m)
        except DriveError as error:
            raise RobotError(str(error)) from error
        stamp = self._own_s(moment.stamp_s, moment.arrived_s)
        self._step = max(self._step + 1, int(stamp / CONTROL_STEP_S))
        return Observation(rgb=rgb, depth=depth, odometry=moment.odometry, stamp=stamp, step=self._step)

    def _own_s(self, stamp_s: float, arrived_s: float) -> float:
        """Convert a stamp of the robot to our clock, which continues if the robot's clock is set."""
        expected_s = self.clock.now() - (time.monotonic() - arrived_s)
        if abs(stamp_s - self._began_s - expected_s) > _CLOCKS_APART_S:
            self._began_s = stamp_s - expected_s
        return stamp_s - self._began_s

    def _send(self, twist: Twist) -> None:
        self._commands.put(twist_message(twist, time.time() if self.profile.driving.stamped else None))
