"""The latest messages of a robot of ROS 2: colours, depth and odometry, matched by their stamps.

Keeps at most one second of each. Filled by the link's threads, read by the observer. Owns the matching and the
description of what is missing; decodes no image.
"""

import math
import threading
from collections import deque
from functools import partial
from typing import Any, NamedTuple

from ltvn_core.errors import RobotError
from ltvn_core.robots.link_report import STALE_S
from ltvn_core.robots.ros2.freshness import Freshness
from ltvn_core.robots.ros2.profile import RobotProfile
from ltvn_core.robots.ros2.robot_topics import RobotTopics
from ltvn_core.robots.ros2.ros_messages import edges_of, read_battery, read_odometry, read_stamp, read_transform
from ltvn_core.robots.ros2.zenoh_link import Received, ZenohLink
from ltvn_core.types import CONTROL_STEP_S, Pose

TOGETHER_S = 0.05
"""Greatest difference between stamps of matched messages, in seconds."""
MOST_LATE_S = 0.5
"""Latency above which a message is not used, relative to the quickest one, in seconds."""
_CLOCK_JUMP_S = 1.0
_JUMPS = 10
"""Number of consecutive stamps with the same jump after which the robot's clock counts as changed."""
_JUMP_LASTS_S = 2 * STALE_S
"""Least duration of these stamps, in seconds, so that the driver is informed of the jump first."""
_KEPT = 30
_LATELY_S = 2.0
_TOUCH_LASTS_S = 2 * CONTROL_STEP_S
"""Time for which a contact of the bumper is reported, in seconds; the navigator asks once per control step."""


class Stamped(NamedTuple):
    """A message and its times."""

    stamp_s: float
    """Stamp of the message, in seconds on the robot's clock."""
    arrived_s: float
    """Time of arrival, in seconds on our monotonic clock."""
    sequence: int
    """Sequence number of the sender."""
    content: Any


class Moment(NamedTuple):
    """Colours, depth and odometry of the same time, not decoded yet."""

    stamp_s: float
    """Stamp of the colours, in seconds on the robot's clock."""
    arrived_s: float
    """Arrival of the last of the three messages, in seconds on our monotonic clock."""
    colour: Any
    depth: Any
    odometry: Pose


class Stream:
    """The newest messages of one topic."""

    def __init__(self, topic: str) -> None:
        self.topic = topic
        self.kept: deque[Stamped] = deque(maxlen=_KEPT)
        self.count = 0
        self.freshness = Freshness(topic, most_late_s=MOST_LATE_S)
        self._jumps = 0
        self._jumped_s = 0.0
        self.refusal: str | None = None
        """Reason why the last message was rejected; None if it was used."""

    def add(self, received: Received, content: Any) -> None:
        """Keep a message. Raises RobotError if it is late, or if its stamp jumped."""
        self.freshness.admit(received.attachment, received.arrived_s)
        stamp_s = read_stamp(received.message, self.topic)
        sequence = received.attachment.sequence
        item = Stamped(stamp_s, received.arrived_s, sequence, content)
        self._check_clock(item)
        self.kept.append(item)
        self.count += 1
        self.refusal = None

    def refuse(self, error: RobotError) -> None:
        """Keep the reason why a message was rejected."""
        self.refusal = str(error)

    def _check_clock(self, item: Stamped) -> None:
        """Drop older messages after the robot's clock was set. Raises RobotError until that is certain."""
        if not self.kept:
            return
        last = self.kept[-1]
        jump_s = (item.stamp_s - last.stamp_s) - (item.arrived_s - last.arrived_s)
        if abs(jump_s) <= _CLOCK_JUMP_S:
            self._jumps = 0
            return
        self._jumps += 1
        if self._jumps == 1:
            self._jumped_s = item.arrived_s
        if self._jumps < _JUMPS or item.arrived_s - self._jumped_s < _JUMP_LASTS_S:
            raise RobotError(f"{self.topic}: its stamps jumped by {jump_s:+.1f} s; was the robot's clock set?")
        self.kept.clear()
        self._jumps = 0

    def nearest(self, stamp_s: float) -> Stamped | None:
        """Return the message with the nearest stamp; None if none is near enough."""
        near = min(self.kept, key=lambda each: abs(each.stamp_s - stamp_s), default=None)
        return near if near is not None and abs(near.stamp_s - stamp_s) <= TOGETHER_S else None

    def age_s(self, now_s: float) -> float | None:
        """Return the time since the last message arrived, in seconds; None if there was none."""
        return now_s - self.kept[-1].arrived_s if self.kept else None

    def rate_hz(self, now_s: float) -> float:
        """Return the mean rate of messages over the last two seconds, per second."""
        lately = [each.arrived_s for each in list(self.kept) if each.arrived_s > now_s - _LATELY_S]
        return len(lately) / (now_s - lately[0] if len(lately) == _KEPT else _LATELY_S)

    @property
    def lost_share(self) -> float:
        """Return the share of the newest messages, in [0, 1], that were sent but did not arrive."""
        kept = list(self.kept)
        sent = kept[-1].sequence - kept[0].sequence + 1 if kept else 1
        return max(0.0, 1 - len(kept) / sent) if kept else 0.0


class SensorInbox:
    """Keeps the latest messages of all topics of a robot."""

    def __init__(self, profile: RobotProfile) -> None:
        """Start without messages."""
        topics = profile.topics
        self.colour, self.depth, self.odometry = map(Stream, (topics.colour, topics.depth, profile.odometry_topic))
        self._edge = profile.odometry_transform
        self.camera_info: Any = None
        """The last CameraInfo."""
        self.battery: float | None = None
        """Charge of the battery, in [0, 1]; None if the robot does not report it."""
        self._is_touching = False
        self._touched_s = -math.inf
        self.truth = Stream(topics.truth)
        """The true pose, if the profile names its topic."""
        self._changed = threading.Condition(threading.RLock())

    @property
    def streams(self) -> tuple[Stream, Stream, Stream]:
        """The streams of colours, depth and odometry."""
        return self.colour, self.depth, self.odometry

    def subscribe(self, link: ZenohLink, topics: RobotTopics) -> None:
        """Receive the messages of a robot."""
        link.subscribe(topics.colour, partial(self._take_image, self.colour), self.colour.refuse)
        link.subscribe(topics.depth, partial(self._take_image, self.depth), self.depth.refuse)
        take_pose = self._take_odometry if self._edge is None else self.take_transforms
        link.subscribe(topics.odometry, take_pose, self.odometry.refuse)
        link.subscribe(topics.camera_info, self._take_camera_info, self.colour.refuse)
        if topics.battery:
            link.subscribe(topics.battery, self._take_battery)
        if topics.bumper:
            link.subscribe(topics.bumper, self.take_bumper)
        if topics.truth:
            link.subscribe(topics.truth, self.take_truth)

    def _take_image(self, stream: Stream, received: Received) -> None:
        self._add(stream, received, received.message)

    def _take_odometry(self, received: Received) -> None:
        self._add(self.odometry, received, read_odometry(received.message, self.odometry.topic))

    def take_transforms(self, received: Received) -> None:
        """Keep the robot's odometry pose from the tf tree; other parts of the tree are ignored."""
        assert self._edge is not None  # Otherwise the topic has no subscription.
        found = edges_of(received.message).get((self._edge.parent, self._edge.child))
        if found is not None:
            pose = read_transform(found, self.odometry.topic)
            self._add(self.odometry, received._replace(message=found), pose)
        elif not self.odometry.count:
            self.odometry.refusal = (
                f"it has no transform from {self._edge.parent} to {self._edge.child}: correct odometry_transform in "
                "the profile"
            )

    def _add(self, stream: Stream, received: Received, content: Any) -> None:
        with self._changed:
            stream.add(received, content)
            self._changed.notify_all()

    def _take_camera_info(self, received: Received) -> None:
        with self._changed:
            self.camera_info = received.message
            self._changed.notify_all()

    def _take_battery(self, received: Received) -> None:
        self.battery = read_battery(received.message)

    def take_bumper(self, received: Received) -> None:
        """Keep the state of the bumper."""
        with self._changed:
            self._is_touching = bool(received.message.data)
            if self._is_touching:
                self._touched_s = received.arrived_s

    def bumper_pressed(self, now_s: float) -> bool:
        """Tell whether the bumper is in contact, or was since the navigator's last request."""
        with self._changed:
            return self._is_touching or now_s - self._touched_s < _TOUCH_LASTS_S

    def take_truth(self, received: Received) -> None:
        """Keep the true pose. Raises RobotError if it is late or invalid."""
        self._add(self.truth, received, read_odometry(received.message, "its true pose"))

    def newest(self) -> Moment | None:
        """Return the newest moment with colours, depth and odometry; None if there is none."""
        with self._changed:
            for colour in reversed(self.colour.kept):
                depth = self.depth.nearest(colour.stamp_s)
                place = self.odometry.nearest(colour.stamp_s)
                if depth is not None and place is not None:
                    arrived_s = max(colour.arrived_s, depth.arrived_s, place.arrived_s)
                    return Moment(colour.stamp_s, arrived_s, colour.content, depth.content, place.content)
        return None

    def wait_for_all(self, patience_s: float) -> bool:
        """Wait until a complete moment and the lens have arrived; tell whether they have."""
        with self._changed:
            return self._changed.wait_for(
                lambda: self.newest() is not None and self.camera_info is not None, patience_s
            )

    def complaint(self, now_s: float) -> str:
        """Return a description of what is missing, topic by topic."""
        words = [] if self.camera_info is not None else ["no CameraInfo came"]
        for stream in self.streams:
            age_s = stream.age_s(now_s)
            said = "never came" if age_s is None else f"came {age_s:.1f} s ago"
            words.append(f"{stream.topic} {said}" + (f" ({stream.refusal})" if stream.refusal else ""))
        return "; ".join(words)
