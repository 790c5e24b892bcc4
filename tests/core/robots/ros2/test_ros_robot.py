"""Commands leave under a lease, and after a break nothing drives until whoever drives has let go."""

import time
from collections.abc import Iterator

import pytest

from ltvn_core.robots.drive_lease import LEASE_S
from ltvn_core.robots.robot_spec import SpeedLimits
from ltvn_core.robots.ros2.ros_robot import CommandSender
from ltvn_core.types import ZERO_TWIST, Twist
from tests.waiting import until

AHEAD = Twist(0.2, 0.0)


class Wire:
    """Keeps what was sent; may be cut."""

    def __init__(self) -> None:
        self.sent: list[Twist] = []
        self.is_whole = True
        self.stall_s = 0.0

    def send(self, twist: Twist) -> None:
        time.sleep(self.stall_s)
        self.sent.append(twist)


@pytest.fixture
def wire() -> Wire:
    return Wire()


@pytest.fixture
def sender(wire: Wire) -> Iterator[CommandSender]:
    opened = CommandSender(wire.send, lambda: wire.is_whole, SpeedLimits())
    yield opened
    opened.close()


def test_a_command_is_repeated_and_its_end_is_one_zero(sender: CommandSender, wire: Wire) -> None:
    assert wire.sent == [ZERO_TWIST]
    sender.drive(AHEAD)

    until(lambda: wire.sent[-1] == ZERO_TWIST and AHEAD in wire.sent)

    assert wire.sent.count(AHEAD) >= 2
    assert wire.sent == [ZERO_TWIST, ZERO_TWIST, *[AHEAD] * wire.sent.count(AHEAD), ZERO_TWIST]


def test_a_stop_is_a_zero_at_once(sender: CommandSender, wire: Wire) -> None:
    sender.drive(AHEAD)
    until(lambda: wire.sent[-1] == AHEAD)

    sender.stop()

    assert wire.sent[-1] == ZERO_TWIST


def test_after_a_break_driving_comes_back_only_once_the_driver_let_go(sender: CommandSender, wire: Wire) -> None:
    sender.drive(AHEAD)
    until(lambda: wire.sent[-1] == AHEAD)
    wire.is_whole = False
    until(lambda: sender.drive(AHEAD) or sender.break_reason)
    wire.is_whole = True
    before = len(wire.sent)
    for _ in range(20):
        sender.drive(AHEAD)
        sender.stop()

    assert sender.break_reason == "the link to the robot broke"
    assert AHEAD not in wire.sent[before:]
    until(lambda: sender.break_reason is None)
    sender.drive(AHEAD)
    until(lambda: wire.sent[-1] == AHEAD)


def paused(sender: CommandSender) -> bool:
    """Drive until the robot is stopped, then let go; tell whether a brief pause of the program was the reason."""
    until(lambda: sender.drive(AHEAD) or sender.break_reason)
    was_paused = sender.was_paused
    until(lambda: sender.break_reason is None)
    return was_paused


def test_a_pause_of_the_program_is_told_from_a_broken_link(sender: CommandSender, wire: Wire) -> None:
    wire.stall_s = 1.2 * LEASE_S
    until(lambda: paused(sender))  # On a busy machine a pause may be longer than a brief one.

    wire.stall_s, wire.is_whole = 0.0, False

    until(lambda: not paused(sender))


def test_a_guard_that_refuses_commands_is_heard_only_while_the_robot_is_driven(
    sender: CommandSender, wire: Wire
) -> None:
    sender.refused("a gap")
    assert sender.break_reason is None

    until(lambda: sender.drive(AHEAD) or sender.refused("a gap") or sender.break_reason)
    assert sender.break_reason == "a gap"
    assert sender.was_paused
    until(lambda: wire.sent[-1] == ZERO_TWIST)
    until(lambda: sender.break_reason is None)
    before = len(wire.sent)
    sender.drive(AHEAD)
    until(lambda: AHEAD in wire.sent[before:])
    assert wire.sent[before] == ZERO_TWIST
