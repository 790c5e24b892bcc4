"""A robot of ROS 2 behind a link that somebody meddles with: messages are held up, lost, exchanged, or changed.

The robot, the one who meddles and the toolkit meet over Zenoh, as they do on a network.
"""

import heapq
import itertools
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from typing import Any, NamedTuple

import numpy as np
import zenoh

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.robots.ros2.profile import RobotProfile, read_profile, shipped_profiles
from ltvn_core.robots.ros2.ros_cameras import CAMERA_INFO
from ltvn_core.robots.ros2.ros_images import IMAGE
from ltvn_core.robots.ros2.ros_messages import camera_info_message, image_message, odometry_message, read_twist
from ltvn_core.robots.ros2.topic_keys import ODOMETRY, TWIST, Topic
from ltvn_core.robots.ros2.zenoh_link import Received, ZenohLink
from ltvn_core.types import ZERO_TWIST, Twist

CAMERA = CameraModel.from_fov(16, 12, 1.2)
EVERY_S = 0.05
_TOPICS = ("/camera/color/image_raw", "/camera/aligned_depth_to_color/image_raw", "/odom", "/camera/color/camera_info")


class Parcel(NamedTuple):
    """A message on its way, as bytes."""

    key: str
    payload: bytes
    attachment: bytes


Meddle = Callable[[Parcel], list[tuple[float, Parcel]]]
"""What becomes of a message: parcels, and after how many seconds each goes on."""


def leave_alone(parcel: Parcel) -> list[tuple[float, Parcel]]:
    return [(0.0, parcel)]


class MeddledRobot:
    """Says 20 times a second what it sees, and writes down what its wheels are told."""

    def __init__(self, link: ZenohLink, profile: RobotProfile) -> None:
        self.link, self.profile = link, profile
        self.told: list[Twist] = []
        self.meddle: Meddle = leave_alone
        self.stamps_ahead_s = 0.0
        self.depth = np.full((12, 16), 2.0, np.float32)
        self._over = threading.Event()
        self._waiting: list[tuple[float, int, Parcel]] = []
        self._count = itertools.count()
        self._lock = threading.Lock()
        kinds = (IMAGE, IMAGE, ODOMETRY, CAMERA_INFO)
        colour, depth, odometry, info = (
            link.publisher(Topic(f"/near{name}", kind)) for name, kind in zip(_TOPICS, kinds, strict=True)
        )
        self._publishers = colour, depth, odometry, info
        link.subscribe(Topic(profile.topics.command, TWIST), self._take, lambda error: None)
        config = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", f'["{link.address}"]')
        config.insert_json5("scouting/multicast/enabled", "false")
        self._session = zenoh.open(config)
        self._subscriber = self._session.declare_subscriber("0/near/**", self._pass_on)
        self._threads = [threading.Thread(target=each) for each in (self._speak, self._deliver)]
        for each in self._threads:
            each.start()

    @property
    def moves(self) -> bool:
        return bool(self.told) and self.told[-1] != ZERO_TWIST

    def close(self) -> None:
        self._over.set()
        for each in self._threads:
            each.join()
        self._session.close()

    def _speak(self) -> None:
        pose = np.zeros(3)
        while not self._over.wait(EVERY_S):
            stamp_s = time.time() + self.stamps_ahead_s
            colour, depth, odometry, info = self._publishers
            odometry.put(odometry_message(pose, ZERO_TWIST, stamp_s))
            info.put(camera_info_message(CAMERA, stamp_s))
            colour.put(image_message(np.full((12, 16, 3), 80, np.uint8), stamp_s))
            depth.put(image_message(self.depth, stamp_s))

    def _pass_on(self, sample: zenoh.Sample) -> None:
        beside: Any = sample.attachment
        key = str(sample.key_expr).replace("0/near/", "0/")
        parcel = Parcel(key, sample.payload.to_bytes(), beside.to_bytes())
        with self._lock:
            for wait_s, each in self.meddle(parcel):
                heapq.heappush(self._waiting, (time.monotonic() + wait_s, next(self._count), each))

    def _deliver(self) -> None:
        while not self._over.wait(0.005):
            with self._lock:
                due = []
                while self._waiting and self._waiting[0][0] <= time.monotonic():
                    due.append(heapq.heappop(self._waiting)[2])
            for each in due:
                self._session.put(each.key, each.payload, attachment=each.attachment)

    def _take(self, received: Received) -> None:
        self.told.append(read_twist(received.message, self.profile.topics.command))


@contextmanager
def meddled_robot() -> Iterator[MeddledRobot]:
    profile = read_profile(shipped_profiles()["sim"], "sim")
    with ZenohLink.listen("tcp/127.0.0.1:0", node="robot") as link, closing(MeddledRobot(link, profile)) as robot:
        yield robot
