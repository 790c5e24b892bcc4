"""Stand-ins for robots of each edition of ROS 2, which write keys, tokens and attachments of `rmw_zenoh` themselves."""

import struct
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from queue import SimpleQueue
from typing import Any, NamedTuple

import numpy as np

from ltvn_core.cameras.camera_model import CameraModel
from ltvn_core.robots.ros2.ros_cameras import CAMERA_INFO
from ltvn_core.robots.ros2.ros_images import IMAGE
from ltvn_core.robots.ros2.ros_messages import camera_info_message, image_message, odometry_message, read_twist
from ltvn_core.robots.ros2.topic_keys import ODOMETRY, TWIST, TWIST_STAMPED, decode, encode, type_hash
from ltvn_core.robots.ros2.zenoh_link import ZenohLink
from ltvn_core.types import ZERO_TWIST, Twist
from tests.waiting import PATIENCE_S

CAMERA = CameraModel.from_fov(16, 12, 1.2, height_m=0.6)
POSE = np.array([1.0, 2.0, 0.5])
COLOUR = 80
DEPTH_M = 2.0
GID = bytes(range(16))
_EVERY_S = 0.05


class Edition(NamedTuple):
    """What differs on the wire between editions."""

    name: str
    has_hashes: bool = True
    names_fields: bool = False
    """Whether the attachment names its fields, as zenoh's serialiser writes them."""
    stamped: bool = False
    """Whether commands are TwistStamped by default."""

    def hash_of(self, kind: str) -> str:
        return type_hash(kind) if self.has_hashes else "TypeHashNotSupported"

    def attachment(self, sequence: int) -> bytes:
        numbers = struct.pack("<q", sequence), struct.pack("<q", time.time_ns()), b"\x10" + GID
        if not self.names_fields:
            return b"".join(numbers)
        names = b"sequence_number", b"source_timestamp", b"source_gid"
        return b"".join(bytes([len(name)]) + name + number for name, number in zip(names, numbers, strict=True))


HUMBLE = Edition("humble", has_hashes=False)
EARLY_JAZZY = Edition("jazzy 0.2.3", names_fields=True)
JAZZY = Edition("jazzy 0.2.4")
KILTED = Edition("kilted", stamped=True)
"""Rolling is the same on the wire."""


class EditionRobot:
    """Declares the topics of the profile `sim`, says what it sees, and notes the commands that reach its wheels."""

    def __init__(
        self, link: ZenohLink, edition: Edition, *, stamped: bool | None = None, namespace: str = "", domain: int = 0
    ) -> None:
        self.reached: SimpleQueue[tuple[Twist, int]] = SimpleQueue()
        self._session: Any = link._session
        self._edition, self._namespace, self._domain = edition, namespace, domain
        self._command = TWIST_STAMPED if (edition.stamped if stamped is None else stamped) else TWIST
        self._declared: list[Any] = [self._session.declare_subscriber(self._key("/cmd_vel", self._command), self._take)]
        self._declare("MS", "/cmd_vel", self._command)

    def _key(self, name: str, kind: str) -> str:
        package, _, message = kind.split("/")
        place = f"{self._domain}{self._namespace}{name}"
        return f"{place}/{package}::msg::dds_::{message}_/{self._edition.hash_of(kind)}"

    def _declare(self, role: str, name: str, kind: str) -> None:
        place = f"@ros2_lv/{self._domain}/{self._session.zid()}/3/{len(self._declared) + 10}/{role}/%"
        mangled = f"{self._namespace}{name}".replace("/", "%")
        kind_and_hash = self._key(name, kind).split("/", mangled.count("%") + 1)[-1]
        node = f"{self._namespace.replace('/', '%') or '%'}/base"
        token = f"{place}/{node}/{mangled}/{kind_and_hash}/::,10:,:,:,,"
        self._declared.append(self._session.liveliness().declare_token(token))

    @contextmanager
    def looking(self) -> Iterator[None]:
        """Publish what it sees 20 times a second."""
        over = threading.Event()
        thread = threading.Thread(target=self._look, args=(over,))
        thread.start()
        try:
            yield
        finally:
            over.set()
            thread.join(PATIENCE_S)

    def _look(self, over: threading.Event) -> None:
        kinds = {
            "/camera/color/image_raw": IMAGE,
            "/camera/aligned_depth_to_color/image_raw": IMAGE,
            "/camera/color/camera_info": CAMERA_INFO,
            "/odom": ODOMETRY,
        }
        for name, kind in kinds.items():
            self._declare("MP", name, kind)
        sequence = 0
        while not over.wait(_EVERY_S):
            stamp_s = time.time()
            sequence += 1
            messages = (
                image_message(np.full((12, 16, 3), COLOUR, np.uint8), stamp_s),
                image_message(np.full((12, 16), DEPTH_M, np.float32), stamp_s),
                camera_info_message(CAMERA, stamp_s),
                odometry_message(POSE, ZERO_TWIST, stamp_s),
            )
            for (name, kind), message in zip(kinds.items(), messages, strict=True):
                attachment = self._edition.attachment(sequence)
                self._session.put(self._key(name, kind), encode(message), attachment=attachment)

    def close(self) -> None:
        for each in self._declared:
            each.undeclare()

    def _take(self, sample: Any) -> None:
        twist = read_twist(decode(sample.payload.to_bytes(), self._command, "/cmd_vel"), "/cmd_vel")
        sequence, _, length, _ = struct.unpack("<qqB16s", sample.attachment.to_bytes())
        assert length == 16
        self.reached.put((twist, sequence))
