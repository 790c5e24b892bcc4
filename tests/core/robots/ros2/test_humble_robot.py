"""A robot of ROS 2 Humble, whose keys and tokens have no hashes of types, gets commands as any other."""

import logging
from collections.abc import Iterator
from queue import Empty, SimpleQueue
from typing import Any, TypeVar

import pytest

from ltvn_core.robots.ros2.guard import Guard
from ltvn_core.robots.ros2.profile import open_profile
from ltvn_core.robots.ros2.ros_messages import read_twist, twist_message
from ltvn_core.robots.ros2.topic_keys import (
    NO_HASH,
    TWIST,
    TWIST_STAMPED,
    Attachment,
    Endpoint,
    Role,
    Topic,
    decode,
    type_hash,
)
from ltvn_core.robots.ros2.zenoh_link import TopicPublisher, ZenohLink
from ltvn_core.types import ZERO_TWIST, Twist
from tests.waiting import PATIENCE_S, until

T = TypeVar("T")
TURN = Twist(0.0, 0.5)


class Wheels:
    """The subscriber to commands of such a robot."""

    def __init__(self, link: ZenohLink, kind: str = TWIST, name: str = "/cmd_vel") -> None:
        self.reached: SimpleQueue[tuple[Twist, int]] = SimpleQueue()
        self._kind, topic = kind, Topic(name, kind)
        session: Any = link._session
        token = Endpoint(session=str(session.zid()), node="base", number=9, role=Role.SUBSCRIBES, topic=topic).token
        self._declared = [
            session.declare_subscriber(topic.unhashed_key, self._take),
            session.liveliness().declare_token(token.replace(type_hash(kind), NO_HASH)),
        ]

    def close(self) -> None:
        for each in self._declared:
            each.undeclare()

    def _take(self, sample: Any) -> None:
        twist = read_twist(decode(sample.payload.to_bytes(), self._kind, "/cmd_vel"), "/cmd_vel")
        self.reached.put((twist, Attachment.from_bytes(sample.attachment.to_bytes(), "/cmd_vel").sequence))


@pytest.fixture
def base() -> Iterator[ZenohLink]:
    with ZenohLink.listen("tcp/127.0.0.1:0", node="base") as link:
        yield link


@pytest.fixture
def driver(base: ZenohLink) -> Iterator[ZenohLink]:
    with ZenohLink.connect(base.address, node="driver") as link:
        yield link


@pytest.mark.parametrize(("kind", "stamp"), [(TWIST, None), (TWIST_STAMPED, 1.0)])
def test_commands_reach_it_and_its_coming_and_going_are_seen(
    base: ZenohLink, driver: ZenohLink, kind: str, stamp: float | None
) -> None:
    commands = driver.command_publisher(Topic("/cmd_vel", kind))
    assert not commands.has_listener
    wheels = Wheels(base, kind)
    until(lambda: commands.has_listener)

    assert _delivered(commands, wheels.reached, twist_message(TURN, stamp), times=2) == [(TURN, 1), (TURN, 2)]
    wheels.close()
    until(lambda: not commands.has_listener)


def test_one_that_was_there_before_is_found(base: ZenohLink, driver: ZenohLink) -> None:
    Wheels(base)
    commands = driver.command_publisher(Topic("/cmd_vel", TWIST))

    until(lambda: commands.has_listener)


def test_a_robot_of_a_later_edition_gets_each_command_once(base: ZenohLink, driver: ZenohLink) -> None:
    reached: SimpleQueue[int] = SimpleQueue()
    base.subscribe(Topic("/cmd_vel", TWIST), lambda received: reached.put(received.attachment.sequence), print)
    commands = driver.command_publisher(Topic("/cmd_vel", TWIST))
    until(lambda: commands.has_listener)

    assert _delivered(commands, reached, twist_message(TURN, None), times=3) == [1, 2, 3]
    with pytest.raises(Empty):
        reached.get(timeout=0.2)


def _delivered(commands: TopicPublisher, reached: SimpleQueue[T], message: Any, times: int) -> list[T]:
    """Send a message several times, each once the one before has arrived: a link that is full drops what comes next."""
    arrived = []
    for _ in range(times):
        commands.put(message)
        arrived.append(reached.get(timeout=PATIENCE_S))
    return arrived


def _drive_off(commands: TopicPublisher) -> None:
    until(lambda: commands.has_listener)
    for twist in (ZERO_TWIST, TURN):
        commands.put(twist_message(twist, None))


def test_the_guard_forwards_to_it(base: ZenohLink, driver: ZenohLink) -> None:
    wheels = Wheels(base)
    guard = Guard(base, open_profile("sim"))
    until(lambda: guard.has_listener)

    _drive_off(driver.publisher(Topic(open_profile("sim").driving.guard_topic, TWIST)))

    assert wheels.reached.get(timeout=PATIENCE_S)[0] == ZERO_TWIST


def test_the_guard_says_where_nobody_takes_its_commands(
    base: ZenohLink, driver: ZenohLink, caplog: pytest.LogCaptureFixture
) -> None:
    guard = Guard(base, open_profile("sim"))
    with caplog.at_level(logging.WARNING):
        _drive_off(driver.publisher(Topic(open_profile("sim").driving.guard_topic, TWIST)))
        until(lambda: guard.forwarded > 0)
        until(lambda: "No node subscribes" in caplog.text)
